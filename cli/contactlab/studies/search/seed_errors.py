"""Errors of points on more seeds than the task has: how well their means are known.

Three seeds say little of the mean over many: it is off by a third where they differ by a half, and
the best of many candidates is best by luck in part. The other seeds give an interval.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from statistics import fmean

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.shares import mean_interval
from contactlab.tasks.reference_error import ErrorEstimate

PRECISION = 0.15
"""Half of an interval, as a share of the mean, that needs no more seeds."""
MOST_SEEDS = 48
"""Seeds of a point at most: the mean is then known to 15 % where seeds differ by a half."""
BATCH = 8
"""Seeds that are run at once, since their states take memory."""


def estimate_mean(first: ErrorEstimate, by_phase: tuple[Floats, ...]) -> ErrorEstimate:
    """Return the error in the worst body and phase on all seeds, with its interval of 95 %.

    The largest mean is at least as large as each low end, and no larger than the largest high end.

    Args:
        first: the error on the seeds of the task.
        by_phase: (S, B) error of each body for each seed, by phase.
    """
    bodies = [body.tolist() for phase in by_phase for body in phase.T]
    worst = max(bodies, key=fmean)
    if not all(map(math.isfinite, worst)):
        return replace(first, low=first.error, high=math.inf, shares=tuple(worst))
    ends = [mean_interval(body) for body in bodies]
    return replace(
        first,
        error=fmean(worst),
        low=max(0.0, *(low for low, _ in ends)),
        high=max(high for _, high in ends),
        shares=tuple(worst),
        by_phase=by_phase,
    )


Measure = Callable[[int, int], ErrorEstimate]
"""Returns the error on fresh seeds: how many of them were used before, and how many to use."""


class SeededPoint:
    """A point with an error that may be measured on more seeds.

    Attributes:
        error: as measured so far, with its interval.
        seconds: counted time of one seed [s].
    """

    def __init__(self, error: ErrorEstimate, seconds: float, measure: Measure) -> None:
        """Begin with the error on the seeds of the task."""
        self.error, self.seconds = estimate_mean(error, error.by_phase), seconds
        self._first, self._measure = error, measure

    @property
    def more_seeds(self) -> int:
        """Number of seeds that the next step adds: as many again; 0 if the interval is narrow."""
        error, seeds = self.error, len(self.error.shares)
        is_known = math.isinf(error.high) or error.high - error.low <= 2 * PRECISION * error.error
        return 0 if is_known else min(seeds, MOST_SEEDS - seeds)

    def add_seeds(self, task_seeds: int) -> None:
        """Measure the point on more seeds; the first `task_seeds` are those of the task."""
        more = self.more_seeds
        while more > 0 and math.isfinite(self.error.high):
            found = self._measure(len(self.error.shares) - task_seeds, min(BATCH, more))
            more -= BATCH
            lost = 0.0 if math.isfinite(found.error) else math.inf
            pairs = zip(self.error.by_phase, found.by_phase, strict=True)
            joined = tuple(np.concatenate((known, new + lost)) for known, new in pairs)
            self.error = estimate_mean(self._first, joined)


def narrow_errors(points: Sequence[SeededPoint], task_seeds: int, allowed: float) -> None:
    """Measure points on more seeds while their intervals are wide and the counted time allows it.

    Each round doubles the seeds of the points with a wide interval, in their order.

    Args:
        points: their errors change.
        task_seeds: number of seeds of the task.
        allowed: counted time [s].
    """
    is_done = False
    while not is_done:
        is_done = True
        for point in points:
            seconds = point.more_seeds * point.seconds
            if 0 < seconds <= allowed:
                point.add_seeds(task_seeds)
                allowed -= seconds
                is_done = False
