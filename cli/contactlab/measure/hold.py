"""Metrics of a body that should be held, over the time in which it should be.

A window holds the steps that begin in [from, to). Runs that end over a step before their window
does are not measured.
"""

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import (
    FORCE,
    LINEAR_VELOCITY,
    NORMAL,
    STICK,
    TANGENT,
    Floats,
    HeldPose,
    PairSeries,
    PairTrace,
    rotate,
)
from contactlab.measure.context import Context, contact_depths, shared
from contactlab.measure.metric import Metric
from contactlab.measure.penetration import worst_pair
from contactlab.measure.rest import down
from contactlab.measure.sliding import switch_masks

_ROUNDING = 1e-6
"""Share of a step by which a time may miss a whole number of steps."""


@shared
def window(context: Context) -> NDArray[np.bool_]:
    """Return (n, N) the steps in which the subject should be held; none where runs end before."""
    trace, hold = context.trace, context.setup.hold
    if hold is None:
        return np.zeros(trace.contacts.shape, dtype=np.bool_)
    first, last = (
        np.ceil(times / trace.timestep - _ROUNDING)[:, None] for times in (hold.start, hold.stop)
    )
    steps = np.arange(trace.steps)
    # A run of a duration that is no whole number of steps may be half a step short.
    return (steps >= first) & (steps < last) & (last <= trace.steps + 1)


@shared
def window_seconds(context: Context) -> Floats:
    """Return (n,) the length of the window [s]; NaN where there is none."""
    steps = window(context).sum(axis=1)
    return np.where(steps > 0, steps, np.nan) * context.trace.timestep


@shared
def hold_switch_masks(context: Context) -> list[NDArray[np.bool_]]:
    """Return for each graded pair (n, N - 1) where its mode changes within the window.

    What is held has no reason to part from its holder, so that contact that a sticking pair loses
    or regains counts too. Sliding pairs hop; their gaps do not.
    """
    inside = window(context)[:, 1:]
    pairs = zip(context.series, switch_masks(context), strict=True)
    return [(mask | _parts_or_meets(series)) & inside for series, mask in pairs]


def _parts_or_meets(series: PairSeries) -> NDArray[np.bool_]:
    bearing, stick = series.normal > 0, series.mode == STICK
    parts = bearing[:, :-1] & stick[:, :-1] & ~bearing[:, 1:]
    meets = ~bearing[:, :-1] & bearing[:, 1:] & stick[:, 1:]
    return parts | meets


def _switches(context: Context) -> Floats:
    counts = [mask.sum(axis=1).astype(np.float64) for mask in hold_switch_masks(context)]
    return (worst_pair(counts) if counts else context.nothing()) / window_seconds(context)


def _penetration(context: Context) -> Floats:
    inside = window(context)
    return worst_pair(
        [
            (depth * inside).sum(axis=1) / (touching & inside).sum(axis=1)
            for touching, depth in contact_depths(context)
        ]
    )


def _slip(context: Context) -> Floats:
    inside = window(context)
    steps = np.flatnonzero(inside.any(axis=0))
    if context.setup.hold is None or not len(steps) or not context.trace.pairs:
        return context.nothing()
    part = slice(int(steps[0]), int(steps[-1]) + 1)
    ways = [_way(pair, part) * inside[:, part, None] for pair in context.trace.pairs]
    timestep = context.trace.timestep[:, None, None]
    farthest = [_farthest(np.cumsum(way * timestep, axis=1)) for way in ways]
    return np.where(inside.any(axis=1), worst_pair(farthest), np.nan)


def _way(pair: PairTrace, part: slice) -> Floats:
    """Return (n, W, 3) the slip velocity [m/s] of a pair, weighted by normal force, world frame."""
    slots = pair.slots[:, part]
    tangent = slots[..., TANGENT]
    across = np.cross(slots[..., NORMAL], tangent)
    _, first, second = np.moveaxis(slots[..., LINEAR_VELOCITY], -1, 0)
    force = slots[..., FORCE.start, None]
    slip = (force * (first[..., None] * tangent + second[..., None] * across)).sum(axis=2)
    total = force.sum(axis=2)
    return slip / np.where(total > 0, total, np.inf)


def _farthest(places: Floats) -> Floats:
    """Return (n,) the largest length of vectors (n, W, 3)."""
    return np.sqrt((places * places).sum(axis=2).max(axis=1))


def _drop(context: Context) -> Floats:
    held, inside = context.trace.held, window(context)
    if held is None:
        return context.nothing()
    run = np.arange(context.trace.runs)
    first = inside.argmax(axis=1)
    last = inside.shape[1] - 1 - inside[:, ::-1].argmax(axis=1)
    way = rotate(held.rotation[run, last], held.position[run, last] - held.position[run, first])
    return np.where(inside.any(axis=1), (way * down(context)).sum(axis=1), np.nan)


def offsets(held: HeldPose) -> Floats:
    """Return (n, N) how far [m] the subject is from where its holder had it at the start."""
    way = held.position - held.position[:, :1]
    return np.sqrt((way * way).sum(axis=2))


def _offset(context: Context) -> Floats:
    held, inside = context.trace.held, window(context)
    if held is None:
        return context.nothing()
    farthest = np.where(inside, offsets(held), 0).max(axis=1)
    return np.where(inside.any(axis=1), farthest, np.nan)


def _contact(context: Context) -> Floats:
    inside = window(context)
    bears = [(series.normal > 0) & inside for series in context.series]
    if not bears:
        return context.nothing()
    return np.logical_or.reduce(bears).sum(axis=1) / np.where(
        inside.any(axis=1), inside.sum(axis=1), np.nan
    )


HOLD = (
    Metric(
        "hold_switches",
        "1/s",
        "lower",
        0,
        1,
        "Changes of a pair's mode over the hold window: between stick and slide as in "
        "mode_switches, and each time that a pair that sticks loses or regains its contact; worst "
        "pair. Above 5 a second a pad chatters.",
        _switches,
    ),
    Metric(
        "hold_penetration",
        "m",
        "lower",
        1e-9,
        1,
        "penetration_mean over the hold window alone. Practice calls grasps under 1 mm plausible, "
        "from 1 to 3 mm a compromise, over 3 mm exploited and over 5 mm broken.",
        _penetration,
    ),
    Metric(
        "hold_slip",
        "m",
        "lower",
        1e-9,
        1,
        "Farthest that a pair slips within the hold window: length of the sum over time of its "
        "tangential velocity in the world frame, weighted by normal force; worst pair. Jitter "
        "cancels, creep adds up.",
        _slip,
    ),
    Metric(
        "hold_drop",
        "m",
        "none",
        1e-9,
        1,
        "How far the subject sinks along gravity within the hold window, relative to the body "
        "that holds it; negative where it rises.",
        _drop,
    ),
    Metric(
        "hold_offset",
        "m",
        "lower",
        1e-9,
        1,
        "Farthest, within the hold window, that the subject is from where the body that holds it "
        "had it at the start of the run; in the frame of that body.",
        _offset,
    ),
    Metric(
        "hold_contact",
        "1",
        "higher",
        0,
        1,
        "Share of the steps of the hold window in which a graded pair bears force.",
        _contact,
    ),
)
