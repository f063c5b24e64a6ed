"""Friction: slip, creep and what the cone allows."""

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import NO_CONTACT, STICK, Floats, PairSeries
from contactlab.measure.context import Context, cached, name_of_worst, runs_where, worst_pair
from contactlab.measure.entries import Finding, Found, MeasuredRuns, Threshold, label, metric
from contactlab.measure.stick_slip import changes

_CREEP_SPEED = Threshold(
    "creep_speed",
    None,
    "m/s",
    "Largest metric creep_speed; only scenes in which what sticks should stay set it.",
)


@cached
def switch_masks(context: Context) -> list[NDArray[np.bool_]]:
    """Return for each monitored pair (n, N - 1) where it changes between stick and slide."""
    return [changes(series) for series in context.series]


@metric("1/s", "lower", tolerance=5.0, version=2, equivalence=True, heading="switches/s")
def mode_switches(context: Context) -> Floats:
    """Changes between stick and slide over simulated time, worst pair.

    From net force and force-weighted slip, with hysteresis, and gaps of up to 100 ms bridged.
    Sticking that never uses less than 0.9 of the friction bound counts as slow sliding. A pad
    with more than 5 a second chatters.
    """
    counts = [mask.sum(axis=1).astype(np.float64) for mask in switch_masks(context)]
    return worst_pair(context, counts) / context.seconds


@metric("m", resolution=1e-9, version=2, equivalence=True)
def slip_distance(context: Context) -> Floats:
    """Slip speed summed over the time in which the pair sticks or slides, worst pair.

    On hops of up to 100 ms between contacts it is interpolated between the speeds beside them.
    """
    speeds = [_with_hops(series).sum(axis=1) for series in context.series]
    return worst_pair(context, speeds) * context.trace.timestep


def _with_hops(series: PairSeries) -> Floats:
    bearing = series.normal > 0
    hops, slip = (series.mode != NO_CONTACT) & ~bearing, series.slip
    if hops.any():
        slip = slip.copy()
        for run in runs_where(np.asarray(hops.any(axis=1))):
            known, gaps = np.flatnonzero(bearing[run]), np.flatnonzero(hops[run])
            slip[run, gaps] = np.interp(gaps, known, slip[run, known])
    return slip


@metric("m/s", "lower", 1e-9, tolerance=1e-4)
def creep_speed(context: Context) -> Floats:
    """Mean slip speed of a sticking pair over the last fifth of the run, worst pair.

    Averaged over the steps in which it bears force. Soft contact creeps under any tangential
    load, at (1 - d0) / (d0 impratio b N) times the acceleration that load would cause.
    """
    return worst_pair(context, _creeps(context))


@cached
def _creeps(context: Context) -> list[Floats]:
    def creep_of(series: PairSeries) -> Floats:
        last = context.last_fifth
        sticking = (series.mode[:, last] == STICK) & (series.normal[:, last] > 0)
        return (series.slip[:, last] * sticking).sum(axis=1) / sticking.sum(axis=1)

    return [creep_of(series) for series in context.series]


@metric("1", "lower", 1e-6)
def cone_violation(context: Context) -> Floats:
    """Most that one contact's tangential force exceeds friction times normal force, as a share.

    In the cone's own norm: the 2-norm if elliptic, the 1-norm if pyramidal.
    """
    return worst_pair(context, [net.excess for net in context.net])


@metric("J", "lower", 1e-12)
def complementarity(context: Context) -> Floats:
    """Largest product of a contact's normal force and its positive distance.

    Separated bodies exert no force; a contact margin lets them, and this is what it costs.
    """
    return worst_pair(context, [net.detached for net in context.net])


@metric("N s", resolution=1e-9, equivalence=True)
def normal_impulse(context: Context) -> Floats:
    """Net normal force summed over time, of the pair with the largest.

    At rest it is weight times time, whatever the contact law.
    """
    forces = [series.normal.sum(axis=1) for series in context.series]
    return worst_pair(context, forces) * context.trace.timestep


@label(28, (_CREEP_SPEED,))
def creep(runs: MeasuredRuns) -> Found:
    """A sticking pair slips faster than the scene accepts."""
    for run, speed, limit in runs.over("creep_speed"):
        name = name_of_worst(runs.context, _creeps(runs.context), run)
        reason = f"{name} sticks, but slips at {speed:.3g} m/s (limit {limit:g} m/s)"
        yield run, Finding(reason, runs.context.last_fifth.start)
