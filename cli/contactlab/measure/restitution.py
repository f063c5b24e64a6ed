"""How much of its speed a body keeps when it bounces off a fixed surface."""

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.contact.trace_setup import Barrier
from contactlab.measure.context import Context, cached
from contactlab.measure.entries import metric
from contactlab.measure.stick_slip import Rows, Spans, spans

_IMPACTS = 5
_WEAKEST = 0.3
_SLOWEST = 0.05
"""Approach speed [m/s] below which a contact is rest or a hop, not an impact."""


@metric("1", resolution=1e-6)
@cached
def restitution_measured(context: Context) -> Floats:
    """Normal speed after an impact over that before, of a free body on a fixed surface.

    Both speeds are those of the free flight next to the contact. Mean over those of the first five
    impacts that are at least 0.3 times as fast as the first; impacts slower than 5 cm/s are rest.
    """
    runs = context.trace.runs
    total, count = np.zeros(runs), np.zeros(runs)
    for barrier in context.setup.barriers:
        run, ratio = _bounces(context, barrier)
        total += np.bincount(run, weights=ratio, minlength=runs)
        count += np.bincount(run, minlength=runs)
    return np.where(count > 0, total / np.where(count > 0, count, 1), np.nan)


def _bounces(context: Context, barrier: Barrier) -> tuple[Rows, Floats]:
    """Return run and restitution of the impacts that count, in order of run and time.

    They are among the first five, and not much weaker than the first.
    """
    touches, rank = _first_touches(context, barrier)
    approach, rebound = _speeds(context, barrier, touches)
    first = np.zeros(context.trace.runs)
    first[touches.run[rank == 0]] = np.nan_to_num(approach[rank == 0])
    counts = (approach >= _SLOWEST) & (approach >= _WEAKEST * first[touches.run])
    counts &= np.isfinite(rebound)
    return touches.run[counts], rebound[counts] / approach[counts]


def _first_touches(context: Context, barrier: Barrier) -> tuple[Spans, Rows]:
    """Return each run's first contacts that have a flight before and after, and their number."""
    found = spans(context.series[barrier.pair].contacts > 0)
    whole = (found.start > 0) & (found.stop < context.trace.steps)
    run = found.run[whole]
    rank = np.arange(len(run)) - np.searchsorted(run, run)
    few = rank < _IMPACTS
    starts, stops = found.start[whole][few], found.stop[whole][few]
    return Spans(run[few], starts, stops), rank[few]


def _speeds(context: Context, barrier: Barrier, touches: Spans) -> tuple[Floats, Floats]:
    """Return the speeds [m/s] at touch before and after each contact, NaN where it is no bounce.

    Both are those of the free flight beside the contact, carried to the height of touch:
    ``v^2 + 2 g s`` is constant on a flight, with s the gap. Of a speculative contact that height
    is unknown; there, the speed is that of the sample itself.
    """
    speculative = context.setup.speculative
    known = 1.0 if speculative is None else ~speculative[touches.run]
    side = np.sign(_height(context, barrier, np.arange(context.trace.runs), 0))[touches.run]
    normal = side[:, None] * barrier.normal
    fall = -(context.setup.gravity[touches.run] * normal).sum(axis=1)

    def speed(free: Rows, touching: Rows, direction: int) -> Floats:
        where = touches.run, free
        dof = barrier.body.dof
        away = (context.trace.qvel[*where, dof : dof + 3] * normal).sum(axis=1)
        depth = context.series[barrier.pair].distance[touches.run, touching]
        at_touch = side * _height(context, barrier, touches.run, touching) - depth
        gap = side * _height(context, barrier, *where) - at_touch
        square = np.maximum(away**2 + 2 * fall * gap * known, 0)
        return np.where(away * direction > 0, np.sqrt(square), np.nan)

    before = speed(touches.start - 1, touches.start, -1)
    return before, speed(touches.stop, touches.stop - 1, 1)


def _height(context: Context, barrier: Barrier, run: Rows, step: Rows | int) -> Floats:
    """Return signed heights [m] of the body's origin above the barrier's mid-plane."""
    start = barrier.body.qpos
    return (context.trace.qpos[run, step, start : start + 3] - barrier.point) @ barrier.normal
