"""The corpus tells the truth: each failing model fails by its measure, and its twin does not."""

import pytest
from tests.verdicts.cases import CASES
from tests.verdicts.corpus import Case, watch


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name.replace(" ", "-"))
def test_failing_and_healthy_are_apart(case: Case) -> None:
    assert case.truth(watch(case.text(healthy=False), case.duration)) > case.limit
    assert case.truth(watch(case.text(healthy=True), case.duration)) < case.limit / 2


def test_names_are_unique() -> None:
    assert len({case.name for case in CASES}) == len(CASES)
