"""Configurations that no other beats in both time and error."""

import numpy as np

from contactlab.contact import Floats


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
