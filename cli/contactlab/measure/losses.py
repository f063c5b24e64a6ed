"""Contacts that a pair keeps losing though nothing pulls it apart.

A pair that sticks well inside its friction bound has no reason to part: losing all its contacts
and regaining them, over and over, is the chatter of a contact too stiff or too weakly damped for
its timestep. Sliding bodies hop too, but at the bound; bodies that bounce to rest touch less hard
every time.
"""

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import FORCE, LINEAR_VELOCITY, STICK, TORQUE, Floats, PairSeries
from contactlab.measure.context import Context, shared
from contactlab.measure.metric import Metric
from contactlab.measure.modes import HELD_USAGE, Spans, spans
from contactlab.measure.penetration import worst_pair

_FRICTIONAL = slice(FORCE.start + 1, TORQUE.stop)
"""Two tangential forces, the torsion and two rolling torques, in the order of the coefficients."""

_IMPACT = 0.05
"""Speed [m/s] from which contacts are impacts; slower ones are rest, which hops by a step."""

_AS_HARD = 0.99
"""Share of the last peak force that the next contact must have; bounces lose more."""


def losses(context: Context, index: int) -> Spans:
    """Return the gaps between contacts of a graded pair that sticks before, in and after them.

    A gap counts if it is at most as long as the contact before it, if on both of its sides every
    contact uses less than 0.9 of its bound on force, torsion and rolling together, and if the pair
    then meets at 5 cm/s or faster and at least as hard, by peak force to within 1 %, as before.
    """
    series = context.series[index]
    bearing = series.normal > 0
    touch, gap = spans(bearing), spans(~bearing)
    inner = (gap.start > 0) & (gap.stop < bearing.shape[1])
    found = Spans(gap.run[inner], gap.start[inner], gap.stop[inner])
    before = _ending(touch, found)
    kept = found.stop - found.start <= touch.stop[before] - touch.start[before]
    kept &= series.mode[found.run, found.start] == STICK
    for step in (found.start - 1, found.stop):
        kept[kept] &= _is_held(context, index, found.run[kept], step[kept])
    kept[kept] &= _approach(context, index, found.run[kept], found.stop[kept]) >= _IMPACT
    peaks = [_peak(series, touch, place) for place in (before[kept], before[kept] + 1)]
    kept[kept] = peaks[1] >= _AS_HARD * peaks[0]
    return Spans(found.run[kept], found.start[kept], found.stop[kept])


def _is_held(
    context: Context, index: int, run: NDArray[np.intp], step: NDArray[np.intp]
) -> NDArray[np.bool_]:
    """Return where a pair sticks and each of its contacts is well inside its whole cone."""
    pair = context.trace.pairs[index]
    slots = pair.slots[run, step]
    acting = np.abs(slots[..., _FRICTIONAL])
    bound = slots[..., FORCE.start, None] * pair.friction[run][:, None]
    share = np.divide(acting, bound, out=np.zeros_like(acting), where=acting > 0)
    elliptic = context.setup.elliptic[run][:, None]
    used = np.where(elliptic, np.sqrt((share * share).sum(axis=2)), share.sum(axis=2))
    return (context.series[index].mode[run, step] == STICK) & (used < HELD_USAGE).all(axis=1)


def _approach(
    context: Context, index: int, run: NDArray[np.intp], step: NDArray[np.intp]
) -> Floats:
    """Return the speed [m/s] along the normal of a pair's fastest contact."""
    slots = context.trace.pairs[index].slots[run, step]
    return np.abs(slots[..., LINEAR_VELOCITY.start]).max(axis=1, initial=0)


def _ending(touch: Spans, gap: Spans) -> NDArray[np.intp]:
    """Return the places of the contacts that end where the gaps start; the next follow them."""
    width = int(max(touch.stop.max(initial=0), gap.stop.max(initial=0))) + 1
    return np.searchsorted(touch.run * width + touch.stop, gap.run * width + gap.start)


def _peak(series: PairSeries, touch: Spans, places: NDArray[np.intp]) -> Floats:
    """Return the largest normal force [N] of contacts."""
    return np.array(
        [
            series.normal[touch.run[place], touch.start[place] : touch.stop[place]].max()
            for place in places
        ]
    )


@shared
def all_losses(context: Context) -> list[Spans]:
    """Return for each graded pair the gaps in which it loses contact while it sticks."""
    return [losses(context, index) for index in range(len(context.series))]


def _contact_losses(context: Context) -> Floats:
    runs = context.trace.runs
    counts = [
        np.bincount(each.run, minlength=runs).astype(np.float64) for each in all_losses(context)
    ]
    return (worst_pair(counts) if counts else context.nothing()) / context.seconds


LOSSES = (
    Metric(
        "contact_losses",
        "1/s",
        "lower",
        0,
        1,
        "How often a pair that sticks, below 0.9 of its friction bound, loses all contact for no "
        "longer than it touched and meets again as hard as before, at 5 cm/s or faster, over "
        "simulated time; worst pair. Above 5 a second a pad chatters.",
        _contact_losses,
    ),
)
