"""Pareto fronts of time and error, and which configuration to use."""

from collections.abc import Mapping, Sequence

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.pareto.configurations import Evaluated, errors, times


def pareto_front(time: Floats, error: Floats) -> list[int]:
    """Return the Pareto front of n points, the cheapest first.

    A point dominates another if it is no worse in both, and better in one; equal points do not
    dominate each other. A point without time or error is on no front.

    Args:
        time: (n,) cost; NaN where unknown.
        error: (n,) likewise.

    Returns:
        Indices of the points that no other point dominates.
    """
    known = np.flatnonzero(np.isfinite(time) & np.isfinite(error))
    order = known[np.lexsort((error[known], time[known]))]
    front: list[int] = []
    for index in order:
        last = front[-1] if front else None
        is_better = last is None or error[index] < error[last]
        if is_better or (error[index] == error[last] and time[index] == time[last]):
            front.append(int(index))
    return front


EQUALLY_FAST = 1.05
"""Ratio of times within which two timing passes of one build agree, on an idle machine."""

_MORE_ACCURATE = 1.05
"""Ratio of errors from which a configuration counts as more accurate."""

SAFE_MARGIN = 1.25
"""Margin of every tolerance that the robust recommendation keeps."""


def equally_fast(evaluated: Sequence[Evaluated], least_margin: float = 0.0) -> list[Evaluated]:
    """Return the feasible configurations that are as fast as the fastest of them, within noise.

    Args:
        evaluated: all configurations.
        least_margin: lower bound on the margin of every tolerance.

    Returns:
        Those whose time is within 5 % of the least, the most accurate first, and equally accurate
        ones in the order of the plan, so that noise of the times decides nothing. Empty if nothing
        is feasible.
    """
    feasible = [
        each for each in evaluated if each.summary.feasible and _is_safe(each, least_margin)
    ]
    if not feasible:
        return []
    limit = EQUALLY_FAST * float(np.min(times(feasible)))
    near = [each for each in feasible if _time(each) <= limit]
    return sorted(near, key=_error)


def feasible_front(evaluated: Sequence[Evaluated]) -> list[Evaluated]:
    """Return the Pareto front of the feasible configurations, the cheapest first."""
    return front_of([each for each in evaluated if each.summary.feasible])


def front_of(evaluated: Sequence[Evaluated]) -> list[Evaluated]:
    """Return the Pareto front of some configurations, the cheapest first."""
    return [evaluated[index] for index in pareto_front(times(evaluated), errors(evaluated))]


def next_more_accurate(front: Sequence[Evaluated], chosen: Evaluated) -> Evaluated | None:
    """Return the cheapest on a front whose error is smaller by a factor of 1.05 at least."""
    limit = _error(chosen) / _MORE_ACCURATE
    return next((each for each in front if _error(each) < limit), None)


def _smallest_margin(margins: Mapping[str, float | None]) -> float:
    """Return the smallest margin; infinity without any."""
    return min((each for each in margins.values() if each is not None), default=np.inf)


def _is_safe(each: Evaluated, least: float) -> bool:
    return _smallest_margin(each.summary.margins) >= least


def _time(each: Evaluated) -> float:
    assert each.summary.time is not None
    return each.summary.time


def _error(each: Evaluated) -> float:
    return np.inf if each.summary.error is None else each.summary.error
