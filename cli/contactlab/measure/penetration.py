"""Metrics of how deep, and how far beyond contact, bodies are."""

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import Floats
from contactlab.measure.context import Context, contact_depths, shared
from contactlab.measure.metric import Metric

_RESTING = 0.9
"""Share of the last half in which a pair must touch to count as resting."""

_LASTING = 0.5
"""Share of the last fifth in which a pair must touch for a steady depth; sliding bodies hop, and
touch in half of the steps."""


def worst_pair(values: list[Floats]) -> Floats:
    """Return (n,) the largest over pairs, NaN only where it applies to none."""
    return np.fmax.reduce(values)


def _largest(context: Context) -> Floats:
    return worst_pair([depth.max(axis=1) for _, depth in contact_depths(context)])


def _mean(context: Context) -> Floats:
    return worst_pair(
        [depth.sum(axis=1) / touching.sum(axis=1) for touching, depth in contact_depths(context)]
    )


@shared
def steady_by_pair(context: Context) -> list[Floats]:
    """Return for each pair (n,) its mean depth [m] in the last fifth; NaN unless it rests there."""
    tail = context.tail
    return [
        np.where(
            touching[:, tail].mean(axis=1) >= _LASTING,
            depth[:, tail].sum(axis=1) / touching[:, tail].sum(axis=1),
            np.nan,
        )
        for touching, depth in contact_depths(context)
    ]


def _steady(context: Context) -> Floats:
    return worst_pair(steady_by_pair(context))


def _growth(context: Context) -> Floats:
    steps = context.trace.steps
    quarter = steps // 4
    if quarter == 0:
        return context.nothing()
    apart = quarter * context.trace.timestep
    half = slice(steps - 2 * quarter, None)

    def slope(touching: NDArray[np.bool_], depth: Floats) -> Floats:
        before = np.median(depth[:, half][:, :quarter], axis=1)
        after = np.median(depth[:, half][:, quarter:], axis=1)
        resting = touching[:, half].mean(axis=1) >= _RESTING
        return np.where(resting, (after - before) / apart, np.nan)

    return worst_pair([slope(*pair) for pair in contact_depths(context)])


def _distance_min(context: Context) -> Floats:
    touching = context.trace.contacts > 0
    least = np.where(touching, context.trace.least_distance, np.inf).min(axis=1)
    return np.where(touching.any(axis=1), least, np.nan)


PENETRATION = (
    Metric(
        "penetration_max",
        "m",
        "lower",
        1e-9,
        1,
        "Largest depth of any contact of the worst pair, at any time. Depth is the negative "
        "contact distance; not defined for speculative contacts, whose distance is no depth.",
        _largest,
    ),
    Metric(
        "penetration_mean",
        "m",
        "lower",
        1e-9,
        1,
        "Depth of a pair's deepest contact, averaged over the steps in which it touches; worst "
        "pair. Bands for grasps: under 1 mm plausible, over 3 mm exploited, over 5 mm broken.",
        _mean,
    ),
    Metric(
        "penetration_steady",
        "m",
        "lower",
        1e-9,
        1,
        "penetration_mean over the last fifth of the run, of pairs that touch in half of it, since "
        "others bounce. What remains at rest is compliance: it follows from load, mass, solref "
        "and solimp, and a smaller timestep does not cure it.",
        _steady,
    ),
    Metric(
        "penetration_growth",
        "m/s",
        "lower",
        1e-9,
        1,
        "Median depth of the last quarter minus that of the third quarter, over a quarter of the "
        "run; worst pair. Only pairs that touch in 90 % of the last half, since others bounce.",
        _growth,
    ),
    Metric(
        "distance_min",
        "m",
        "higher",
        1e-9,
        1,
        "Least signed distance of any contact in the model, graded or not; positive where "
        "contacts with a margin never close.",
        _distance_min,
    ),
)
