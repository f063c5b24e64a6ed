"""Metrics of friction: sticking, sliding, and what the cone allows."""

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import SLIDE, STICK, Floats, PairSeries
from contactlab.measure.context import Context, shared
from contactlab.measure.metric import Metric
from contactlab.measure.modes import HELD_USAGE, spans, switches
from contactlab.measure.penetration import worst_pair


def changes(series: PairSeries) -> NDArray[np.bool_]:
    """Return (n, N - 1) where a pair changes between stick and slide at the next sample.

    Sticking that never uses less than 0.9 of the friction bound is part of the slides beside it:
    a slow slide, whose speed wavers about the least that counts as sliding, does not stick.
    """
    mode = series.mode
    if not (mode == SLIDE).any():
        return np.zeros(mode[:, 1:].shape, dtype=np.bool_)
    stick = spans(mode == STICK)
    held = (series.normal > 0) & (series.usage < HELD_USAGE)
    before = np.zeros((mode.shape[0], mode.shape[1] + 1), dtype=np.int32)
    np.cumsum(held, axis=1, out=before[:, 1:])
    merged = mode.copy()
    for run, start, stop in zip(stick.run, stick.start, stick.stop, strict=True):
        if before[run, stop] == before[run, start]:
            merged[run, start:stop] = SLIDE
    return switches(merged)


@shared
def switch_masks(context: Context) -> list[NDArray[np.bool_]]:
    """Return for each graded pair (n, N - 1) where it changes between stick and slide."""
    return [changes(series) for series in context.series]


def _over_pairs(context: Context, values: list[Floats]) -> Floats:
    return worst_pair(values) if values else context.nothing()


def _mode_switches(context: Context) -> Floats:
    counts = [mask.sum(axis=1).astype(np.float64) for mask in switch_masks(context)]
    return _over_pairs(context, counts) / context.seconds


def _slip_distance(context: Context) -> Floats:
    speeds = [series.slip.sum(axis=1) for series in context.series]
    return _over_pairs(context, speeds) * context.trace.timestep


def _creep_speed(context: Context) -> Floats:
    def creep(series: PairSeries) -> Floats:
        sticking = (series.mode[:, context.tail] == STICK) & (series.normal[:, context.tail] > 0)
        return (series.slip[:, context.tail] * sticking).sum(axis=1) / sticking.sum(axis=1)

    return _over_pairs(context, [creep(series) for series in context.series])


def _cone_violation(context: Context) -> Floats:
    return _over_pairs(context, [folded.excess for folded in context.folded])


def _complementarity(context: Context) -> Floats:
    return _over_pairs(context, [folded.detached for folded in context.folded])


def _normal_impulse(context: Context) -> Floats:
    forces = [series.normal.sum(axis=1) for series in context.series]
    return _over_pairs(context, forces) * context.trace.timestep


SLIDING = (
    Metric(
        "mode_switches",
        "1/s",
        "lower",
        0,
        2,
        "Changes between stick and slide over simulated time, worst pair; from net force and "
        "force-weighted slip, with hysteresis, and gaps of up to 100 ms bridged. Sticking that "
        "never uses less than 0.9 of the friction bound counts as slow sliding. Above 5 a second "
        "a pad chatters.",
        _mode_switches,
    ),
    Metric(
        "slip_distance",
        "m",
        "none",
        1e-9,
        1,
        "Slip speed summed over the steps in which the pair bears force, worst pair.",
        _slip_distance,
    ),
    Metric(
        "creep_speed",
        "m/s",
        "lower",
        1e-9,
        1,
        "Mean slip speed over the steps of the last fifth in which the pair bears force and "
        "sticks, worst pair. Soft contact creeps under any tangential load, at "
        "(1 - d0) / (d0 impratio b N) times the acceleration that load would cause.",
        _creep_speed,
    ),
    Metric(
        "cone_violation",
        "1",
        "lower",
        1e-6,
        1,
        "Most that one contact's tangential force exceeds friction times normal force, as a share "
        "and in the cone's own norm: the 2-norm if elliptic, the 1-norm if pyramidal.",
        _cone_violation,
    ),
    Metric(
        "complementarity",
        "J",
        "lower",
        1e-12,
        1,
        "Largest product of a contact's normal force and its positive distance. Bodies apart "
        "exert no force; a contact margin lets them, and this is what it costs.",
        _complementarity,
    ),
    Metric(
        "normal_impulse",
        "N s",
        "none",
        1e-9,
        1,
        "Net normal force summed over time, of the pair with most. At rest it is weight times "
        "time, whatever the contact law.",
        _normal_impulse,
    ),
)
