"""An examination in one sentence: when it was, counted from the beginning of the run."""

import re

import pytest

from contactlab.budget import ErrorBudget, Verdict
from contactlab.budget.verdict import Reason
from contactlab.schema.task import Phase, Task
from contactlab.studies.examine import examination


def said(phase: str, time: float) -> str:
    """Return the sentence of a task whose excitement begins 1.5 s after its rest."""
    task = Task(
        start="home",
        drive="exercise",
        own_controls=True,
        duration=4.0,
        phases=(
            Phase(name="held", begin=0.0, end=1.5),
            Phase(name="excitement", begin=1.5, end=4.0),
        ),
    )
    reason = Reason("unresolved", phase, "run", 0.4, "mug", "floor - mug", time, "40 % of it")
    verdict = Verdict("unresolved", 0.1, (reason,))
    return examination._sentence(  # pyright: ignore[reportPrivateUsage]
        verdict, (), task, ErrorBudget(())
    )


@pytest.mark.parametrize("time", [0.0, 0.25, 1.2])
@pytest.mark.parametrize(("phase", "begin"), [("held", 0.0), ("excitement", 1.5)])
def test_a_time_counts_from_the_beginning_of_the_run(phase: str, begin: float, time: float) -> None:
    """A reason's counts from the beginning of its phase."""
    found = re.search(r" at (\d+\.\d+) s", said(phase, time))
    assert found is not None
    assert float(found[1]) == pytest.approx(begin + time, abs=0.005)


def test_where_no_time_is_known_the_phase_is_named() -> None:
    sentence = said("excitement", float("nan"))
    assert "in the phase excitement" in sentence
    assert re.search(r" at \d", sentence) is None


@pytest.mark.parametrize("late", [False, True])
def test_that_nothing_helps_is_not_said_of_what_was_not_tried(late: bool) -> None:
    words = examination._remedied((), late=late)  # pyright: ignore[reportPrivateUsage]
    assert ("no time to try changes" in words) == late
