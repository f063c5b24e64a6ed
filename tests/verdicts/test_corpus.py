"""The corpus tells the truth: each failing model fails by its measure, and its twin does not."""

import pytest
from tests.verdicts.cases import CASES
from tests.verdicts.corpus import Case, watch
from tests.verdicts.held_back import HELD_BACK
from tests.verdicts.held_back_2 import HELD_BACK_2

ALL = [*CASES, *HELD_BACK, *HELD_BACK_2]
# A sweep starts its runs about as far from where the model says.
NUDGES = (0.0, 1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("nudge", NUDGES)
@pytest.mark.parametrize("case", ALL, ids=lambda case: case.name.replace(" ", "-"))
def test_failing_and_healthy_are_apart(case: Case, nudge: float) -> None:
    if case.failing:
        assert case.truth(watch(case.text(healthy=False), case.duration, nudge=nudge)) > case.limit
    assert case.truth(watch(case.text(healthy=True), case.duration, nudge=nudge)) < case.limit / 2


def test_names_are_unique() -> None:
    assert len({case.name for case in ALL}) == len(ALL)
