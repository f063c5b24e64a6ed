"""Configurations that no other beats in both time and error."""

from collections.abc import Mapping, Sequence

import numpy as np

from contactlab.contact import Floats
from contactlab.tradeoff.configurations import Evaluated, errors, times


def front(time: Floats, error: Floats) -> list[int]:
    """Return which of n points no other point dominates, cheapest first.

    A point dominates another if it is no worse in both, and better in one; equal points do not
    dominate each other. A point without time or error is on no front.

    Args:
        time: (n,) cost; NaN where unknown.
        error: (n,) likewise.

    Returns:
        Places of the points.
    """
    known = np.flatnonzero(np.isfinite(time) & np.isfinite(error))
    order = known[np.lexsort((error[known], time[known]))]
    kept: list[int] = []
    for index in order:
        last = kept[-1] if kept else None
        is_better = last is None or error[index] < error[last]
        if is_better or (error[index] == error[last] and time[index] == time[last]):
            kept.append(int(index))
    return kept


# Within this two passes of the same build agree on ratios of times, on an idle machine.
EQUALLY_FAST = 1.05
WORTH_A_STEP = 1.05
SAFE_MARGIN = 1.25


def equally_fast(found: Sequence[Evaluated], least_margin: float = 0.0) -> list[Evaluated]:
    """Return the feasible configurations that time cannot tell from the cheapest of them.

    Args:
        found: all configurations.
        least_margin: what the margin of every tolerance must be at least.

    Returns:
        Those whose time is within 5 % of the least, the most accurate first, and equally accurate
        ones in the order of the plan: noise of the times decides nothing. Empty if nothing is
        feasible.
    """
    fit = [each for each in found if each.summary.feasible and _is_safe(each, least_margin)]
    if not fit:
        return []
    limit = EQUALLY_FAST * float(np.min(times(fit)))
    near = [each for each in fit if _time(each) <= limit]
    return sorted(near, key=_error)


def feasible_front(found: Sequence[Evaluated]) -> list[Evaluated]:
    """Return the feasible configurations that no feasible one beats in both, cheapest first."""
    return on_front([each for each in found if each.summary.feasible])


def on_front(found: Sequence[Evaluated]) -> list[Evaluated]:
    """Return the configurations that none beats in both time and error, cheapest first."""
    return [found[index] for index in front(times(found), errors(found))]


def next_on(line: Sequence[Evaluated], chosen: Evaluated) -> Evaluated | None:
    """Return the cheapest on a front that is more accurate than a configuration, by 5 % or more."""
    limit = _error(chosen) / WORTH_A_STEP
    return next((each for each in line if _error(each) < limit), None)


def shortest_margin(margins: Mapping[str, float | None]) -> float:
    """Return the least margin; infinite without any."""
    return min((each for each in margins.values() if each is not None), default=np.inf)


def _is_safe(each: Evaluated, least: float) -> bool:
    return shortest_margin(each.summary.margins) >= least


def _time(each: Evaluated) -> float:
    assert each.summary.time is not None
    return each.summary.time


def _error(each: Evaluated) -> float:
    return np.inf if each.summary.error is None else each.summary.error
