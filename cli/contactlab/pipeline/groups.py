"""Measure and label the runs of a job: whole runs at once, those cut short one by one."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from contactlab.measure import Assessment, assess
from contactlab.sim import Rollout
from contactlab.trace import Checks, Setup, Trace

CheckRuns = Callable[[Sequence[int], Trace], Checks]


@dataclass(frozen=True)
class Group:
    """Runs that were measured together.

    Attributes:
        places: their places in the job.
        trace: their arrays.
        setup: what is known of them beside.
        assessment: their metrics and labels.
    """

    places: tuple[int, ...]
    trace: Trace
    setup: Setup
    assessment: Assessment


def measured_groups(
    trace: Trace, setup: Setup, rollout: Rollout, rule: str, check: CheckRuns
) -> Iterator[Group]:
    """Yield every run of a job in one group.

    Args:
        trace: the job's arrays.
        setup: what is known of its runs.
        rollout: what the engine returned.
        rule: which whole runs get a second pass: all, flagged or none.
        check: makes the second pass over the runs at some places of the job.
    """
    trace = _without_momentum(trace, setup)
    whole = [place for place, steps in enumerate(rollout.steps) if steps == trace.steps_asked]
    if whole:
        picked = trace.pick(whole), setup.pick(whole)
        yield from _checked(whole, *picked, rule, check)
    for place in sorted(set(range(trace.runs)) - set(whole)):
        cut, alone = trace.pick([place], rollout.steps[place]), setup.pick([place])
        yield Group((place,), cut, alone, assess(cut, alone))


def _checked(
    places: Sequence[int], trace: Trace, setup: Setup, rule: str, check: CheckRuns
) -> Iterator[Group]:
    """Yield whole runs, those that the rule asks for measured again with their checks."""
    assessment = assess(trace, setup)
    suspects = [row for row in range(trace.runs) if _asks(rule, assessment, row)]
    others = [row for row in range(trace.runs) if row not in suspects]
    if not suspects:
        yield Group(tuple(places), trace, setup, assessment)
        return
    there = [places[row] for row in suspects]
    picked, known = trace.pick(suspects), setup.pick(suspects)
    again = assess(picked, known, check(there, picked))
    yield Group(tuple(there), picked, known, again)
    if others:
        rest, known = trace.pick(others), setup.pick(others)
        yield Group(tuple(places[row] for row in others), rest, known, assess(rest, known))


def _asks(rule: str, assessment: Assessment, row: int) -> bool:
    return rule == "all" or (rule == "flagged" and assessment.labels[row][0].label != "stable")


def _without_momentum(trace: Trace, setup: Setup) -> Trace:
    """Mark the momenta of runs with gravity as not measured, run by run."""
    falling = np.asarray(setup.gravity.any(axis=1))[:, None, None]
    if trace.momentum is None or trace.spin is None or not falling.any():
        return trace
    return replace(
        trace,
        momentum=np.where(falling, np.nan, trace.momentum),
        spin=np.where(falling, np.nan, trace.spin),
    )
