"""Measure and label the runs of a job: whole runs at once, those cut short one by one."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from contactlab.contact import SelfChecks, Setup, Trace
from contactlab.engines import Rollout
from contactlab.measure import Assessment, assess

CheckRuns = Callable[[Sequence[int], Trace], SelfChecks]


@dataclass(frozen=True)
class Group:
    """Runs, and the arrays and measurements that hold them.

    Attributes:
        places: their places in the job.
        rows: their places in the arrays and measurements.
        trace: the arrays.
        assessment: metrics and labels.
    """

    places: Sequence[int]
    rows: Sequence[int]
    trace: Trace
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
        yield Group([place], [0], cut, assess(cut, alone))


def _checked(
    places: Sequence[int], trace: Trace, setup: Setup, rule: str, check: CheckRuns
) -> Iterator[Group]:
    """Yield whole runs as measured, and those that the rule asks for once more, with checks.

    Of the latter some are missing if the second pass is cut short.
    """
    assessment = assess(trace, setup)
    suspects = [row for row in range(trace.runs) if _asks(rule, assessment, row)]
    others = sorted(set(range(trace.runs)) - set(suspects))
    yield Group([places[row] for row in others], others, trace, assessment)
    if suspects:
        picked = trace.pick(suspects)
        checks = check([places[row] for row in suspects], picked)
        done = range(checks.runs)
        checked, known = picked.pick(done), setup.pick([suspects[row] for row in done])
        again = assess(checked, known, checks)
        yield Group([places[suspects[row]] for row in done], done, checked, again)


def _asks(rule: str, assessment: Assessment, row: int) -> bool:
    return rule == "all" or (rule == "flagged" and assessment.labels[row][0].label != "stable")


def _without_momentum(trace: Trace, setup: Setup) -> Trace:
    """Mark the momenta of runs with gravity as not measured, run by run."""
    falling = np.asarray(setup.gravity.any(axis=1))[:, None, None]
    if trace.momentum is None or trace.angular_momentum is None or not falling.any():
        return trace
    return replace(
        trace,
        momentum=np.where(falling, np.nan, trace.momentum),
        angular_momentum=np.where(falling, np.nan, trace.angular_momentum),
    )
