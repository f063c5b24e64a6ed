"""Each case of the catalogue with all of its seeds."""

from pathlib import Path
from typing import Any

import pytest
from tests.studies.stability import test_closed_forms, test_conservation_cases, test_resting_cases
from tests.studies.stability.conftest import FOLDER, swept

pytestmark = pytest.mark.night

CASES = [
    *test_closed_forms.CASES,
    *test_conservation_cases.CASES,
    *test_resting_cases.CASES,
]


@pytest.mark.parametrize("name", CASES)
def test_every_seed_comes_out_as_expected(assert_expected: Any, tmp_path: Path, name: str) -> None:
    assert_expected(swept(FOLDER / f"{name}.yaml", tmp_path / "store"))
