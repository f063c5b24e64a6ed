"""The corpus tells the truth: each failing model fails by its measure, and its twin does not."""

import os

import numpy as np
import pytest
from tests.verdicts.corpus import Case, read_corpus
from tests.verdicts.motion import watch

PARTS = read_corpus()
# All where WHOLE_CATALOGUE is set; else a share of what takes minutes.
WHOLE = "WHOLE_CATALOGUE" in os.environ
# A sweep starts its runs about as far from where the model says.
NUDGES = (0.0, 1e-4)


def of(*names: str) -> list[Case]:
    return [case for part in PARTS if part.name in names for case in part.cases]


SHARED, NEW = of("held_back_6"), of(*(f"held_back_{number}" for number in range(7, 17)))
_OTHERS = [case for part in PARTS if part.name != "held_back_6" for case in part.cases]
APART = _OTHERS + SHARED[:: 1 if WHOLE else 4]
_FINE = [*of("held_back_4", "held_back_5"), *SHARED, *(case for case in NEW if not case.chaotic)]
_EIGHT = _FINE[:: 1 if WHOLE else 8]
FINER = [*((case, 2) for case in of("held_back_3")), *((case, 8) for case in _EIGHT)]
"""Cases, and by how much shorter steps each is checked."""
pytestmark = pytest.mark.night


def slug(case: Case) -> str:
    return case.name.replace(" ", "-")


@pytest.mark.parametrize("nudge", NUDGES)
@pytest.mark.parametrize("case", APART, ids=slug)
def test_failing_and_healthy_are_apart(case: Case, nudge: float) -> None:
    for healthy in case.told:
        number = case.truth.measure(watch(case.text(healthy=healthy), case.duration, nudge=nudge))
        assert number < case.limit / 2 if healthy else number > case.limit
        key = "healthy" if healthy else "failing"
        told = [case.measured.get(each, np.nan) for each in (key, f"{key}, nudged")]
        # Where a nudge changes nothing, neither does another machine. Three digits are told.
        if told[0] == pytest.approx(told[1], rel=0.01):
            expected = pytest.approx(told[NUDGES.index(nudge)], rel=0.005, abs=1e-6)
            assert number / case.limit == expected


@pytest.mark.parametrize(
    ("case", "factor"), FINER, ids=lambda value: slug(value) if isinstance(value, Case) else None
)
def test_failing_is_silent_and_healthy_does_not_hang_on_the_step(case: Case, factor: int) -> None:
    if case.failing is not None and case not in NEW:
        # The engine warns, and starts the time again, where it sees a failure itself.
        assert (np.diff(watch(case.text(healthy=False), case.duration).time) > 0).all()
    if case.healthy is not None:
        finer = watch(case.text(healthy=True), case.duration, factor=factor)
        assert case.truth.measure(finer) < case.limit / 2
