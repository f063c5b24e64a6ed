"""Where free bodies pass through the fixed surfaces that should stop them."""

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import Barrier, Floats
from contactlab.measure.context import Context


def first_crossings(context: Context, barrier: Barrier) -> dict[int, int]:
    """Return by run the first step in which the body's origin passes the barrier.

    It passes where its signed height over the mid-plane changes sign within the barrier's reach;
    between two states it moves in a straight line.
    """
    height = _heights(context, barrier)
    above = height >= 0
    changed = above[:, 1:] != above[:, :-1]
    found: dict[int, int] = {}
    for run in np.flatnonzero(changed.any(axis=1)).tolist():
        steps = np.flatnonzero(changed[run])
        inside = steps[_within_reach(context, barrier, run, steps, height[run])]
        if len(inside):
            found[run] = int(inside[0])
    return found


def _heights(context: Context, barrier: Barrier) -> Floats:
    """Return (n, N + 1) heights [m] of the body's origin above the barrier's mid-plane."""
    height = np.full(context.trace.qpos.shape[:2], -float(barrier.point @ barrier.normal))
    for axis in np.flatnonzero(barrier.normal).tolist():
        height += context.trace.qpos[:, :, barrier.body.qpos + axis] * barrier.normal[axis]
    return height


def _within_reach(
    context: Context, barrier: Barrier, run: int, steps: NDArray[np.intp], height: Floats
) -> NDArray[np.bool_]:
    start = barrier.body.qpos
    position = context.trace.qpos[run, :, start : start + 3]
    share = (height[steps] / (height[steps] - height[steps + 1]))[:, None]
    met = position[steps] + share * (position[steps + 1] - position[steps])
    offset = met - barrier.point
    offset -= (offset @ barrier.normal)[:, None] * barrier.normal
    return np.linalg.norm(offset, axis=1) < barrier.reach
