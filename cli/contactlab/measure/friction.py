"""Friction: slip, creep and what the cone allows; labels of what should stick or slide."""

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import SLIDE, STICK, Floats, PairSeries
from contactlab.contact.trace_setup import SlipMode
from contactlab.measure.context import Context, cached, worst_pair
from contactlab.measure.entries import Finding, Found, MeasuredRuns, Threshold, label, metric
from contactlab.measure.stick_slip import Modes, changes, spans

_MODES: dict[SlipMode, int] = {"stick": STICK, "slide": SLIDE}
_CREEP_SPEED = Threshold(
    "creep_speed",
    None,
    "m/s",
    "Largest metric creep_speed; only scenes in which what sticks should stay set it.",
)
_MODE_HOLD = Threshold(
    "mode_hold",
    0.02,
    "s",
    "Shortest time that a mode lasts to count as the first or the last of a pair. Measured: "
    "sliding is told from sticking to within 4 to 24 ms.",
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


@metric("m", resolution=1e-9, equivalence=True)
def slip_distance(context: Context) -> Floats:
    """Slip speed summed over the steps in which the pair bears force, worst pair."""
    speeds = [series.slip.sum(axis=1) for series in context.series]
    return worst_pair(context, speeds) * context.trace.timestep


@metric("m/s", "lower", 1e-9, tolerance=1e-4)
def creep_speed(context: Context) -> Floats:
    """Mean slip speed of a sticking pair over the last fifth of the run, worst pair.

    Averaged over the steps in which it bears force. Soft contact creeps under any tangential
    load, at (1 - d0) / (d0 impratio b N) times the acceleration that load would cause.
    """

    def creep_of(series: PairSeries) -> Floats:
        last = context.last_fifth
        sticking = (series.mode[:, last] == STICK) & (series.normal[:, last] > 0)
        return (series.slip[:, last] * sticking).sum(axis=1) / sticking.sum(axis=1)

    return worst_pair(context, [creep_of(series) for series in context.series])


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
        reason = f"a pair that sticks slips at {speed:.3g} m/s (limit {limit:g} m/s)"
        yield run, Finding(reason, runs.context.last_fifth.start)


@label(24, (_MODE_HOLD,))
def unexpected_slide(runs: MeasuredRuns) -> Found:
    """A pair slides first or last, where the scene expects it to stick."""
    return _unexpected(runs, "stick", "slide")


@label(20, (_MODE_HOLD,))
def unexpected_stick(runs: MeasuredRuns) -> Found:
    """A pair sticks first or last, where the scene expects it to slide."""
    return _unexpected(runs, "slide", "stick")


def _unexpected(runs: MeasuredRuns, wanted: SlipMode, met: SlipMode) -> Found:
    setup = runs.context.setup
    for when, place, mode in (("first", 0, setup.first_mode), ("last", -1, setup.last_mode)):
        for series in runs.context.series if mode == wanted else ():
            for run, lasting in _lasting_modes(series.mode, runs).items():
                value, step = lasting[place]
                if value == _MODES[met]:
                    yield (
                        run,
                        Finding(f"{series.name} should {wanted} {when}, but does {met}", step),
                    )


def _lasting_modes(mode: Modes, runs: MeasuredRuns) -> dict[int, list[tuple[int, int]]]:
    """Return by run the modes that last, in order, each with its first step."""
    shortest = np.ceil(runs.limits["mode_hold"] / runs.context.trace.timestep - 1e-6)
    lasting = sorted(
        (run, start, value)
        for value in (STICK, SLIDE)
        for found in [spans(mode == value)]
        for run, start, stop in np.stack([found.run, found.start, found.stop], axis=1).tolist()
        if stop - start >= shortest[run]
    )
    modes: dict[int, list[tuple[int, int]]] = {}
    for run, start, value in lasting:
        modes.setdefault(run, []).append((value, start))
    return modes
