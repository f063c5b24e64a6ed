"""A sweep with requirements alone has no expectations, and its summary names the judge of them."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from contactlab.judge.expectations import EXPECTED, expectation_findings
from contactlab.store.finished_store import Store


def store_of(must: list[str]) -> Store:
    manifest: dict[str, Any] = {
        "statuses": {"ok": 3},
        "runs": 3,
        "expectations": {"none": 3},
        "labels": {"stable": 3},
        "sweep": SimpleNamespace(resolved={"must": must}),
        "unmet_means": (),
    }
    none = SimpleNamespace(valid=np.zeros(3, bool), values=np.zeros(3))
    columns = SimpleNamespace(numbers=lambda _: none)
    return cast("Store", SimpleNamespace(manifest=SimpleNamespace(**manifest), columns=columns))


@pytest.mark.parametrize("must", [[], ["upright(torso)"]])
def test_requirements_are_not_called_missing(must: list[str]) -> None:
    (said,) = [each for each in expectation_findings(store_of(must)) if each.name == EXPECTED]
    assert said.outcome == "skipped"
    assert ("labels judge its `must`" in said.message) == bool(must)
