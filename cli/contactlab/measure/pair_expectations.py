"""Labels of pairs that do not do what their scene or sweep expects of them."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import NO_CONTACT, SLIDE, STICK, Floats
from contactlab.contact.trace_setup import ExpectedContact
from contactlab.measure.context import Context, contact_depths, first_step, runs_where
from contactlab.measure.coverage import TURNING
from contactlab.measure.entries import Finding, Found, MeasuredRuns, Threshold, label
from contactlab.measure.stick_slip import spans

PAIR_LABELS = frozenset({"unexpected_slide", "unexpected_stick", "pair_expectation"})
_VERBS = {"stick": "stick", "slide": "slide", "apart": "be apart", "rolls": "roll"}
_MODES = {"stick": STICK, "rolls": STICK, "slide": SLIDE}
_MODE_HOLD = Threshold(
    "mode_hold",
    0.02,
    "s",
    "Shortest time for which a pair's mode counts, and over which the force that is expected of "
    "it is averaged. Measured: sliding is told from sticking to within 4 to 24 ms.",
)
_ROUNDING = 1e-6
"""Share of a step by which a time may miss the start of a step."""

Mask = NDArray[np.bool_]


@label(24, (_MODE_HOLD,))
def unexpected_slide(runs: MeasuredRuns) -> Found:
    """A pair slides that is expected to stick or to roll."""
    return _unexpected(runs, SLIDE)


@label(20, (_MODE_HOLD,))
def unexpected_stick(runs: MeasuredRuns) -> Found:
    """A pair sticks that is expected to slide."""
    return _unexpected(runs, STICK)


@label(26, (_MODE_HOLD,))
def pair_expectation(runs: MeasuredRuns) -> Found:
    """A pair does not press, touch, part or roll as expected, or is deeper."""
    for each in runs.context.setup.expected:
        inside = _inside(runs.context, each)
        for run in runs_where(np.asarray(inside.any(axis=1))) if each.is_more_than_ends else ():
            faults = _faults(runs.context, each, run, inside[run], runs.limits["mode_hold"])
            for wanted, met, where in faults:
                step = first_step(where)
                time = runs.context.trace.time[run, step]
                yield run, Finding(f"{wanted}, but {met}, from {time:.4g} s on", step)


def _unexpected(runs: MeasuredRuns, met: int) -> Found:
    """Find pairs that slide or stick for long where they are expected to do the other."""
    for each in runs.context.setup.expected:
        asked = ((" first", each.first), (" last", each.last), ("", each.mode))
        wanted = [(when, mode) for when, mode in asked if mode and _MODES.get(mode, met) != met]
        for index in each.pairs if wanted else ():
            series = runs.context.series[index]
            mode = np.where(_inside(runs.context, each), series.mode, NO_CONTACT)
            for run, lasting in _lasting_modes(mode, runs).items():
                time = runs.context.trace.time[run]
                for when, what in wanted:
                    some = {" first": lasting[:1], " last": lasting[-1:]}.get(when, lasting)
                    for start, stop in (
                        (start, stop) for value, start, stop in some if value == met
                    ):
                        speed = series.slip[run, start:stop].max()
                        slides = f"slides, at up to {speed:.3g} m/s," if met == SLIDE else "sticks"
                        reason = (
                            f"{series.name} should {_VERBS[what]}{when}, but {slides} "
                            f"from {time[start]:.4g} to {time[stop]:.4g} s"
                        )
                        yield run, Finding(reason, start)


def _faults(
    context: Context, each: ExpectedContact, run: int, inside: Mask, hold: float
) -> Iterator[tuple[str, str, Mask]]:
    """Yield what was expected, what is met instead and the steps (N,) in which it is."""
    timestep, (least, most) = float(context.trace.timestep[run]), each.force
    width = max(round(hold / timestep), 1)
    series = [context.series[index] for index in each.pairs]
    touching = inside & np.any([one.mode[run] != NO_CONTACT for one in series], axis=0)
    judged = inside if each.timed else touching
    gaps = _lasting(inside & ~touching, width) if each.timed or not touching.any() else inside[:0]
    if (each.mode in _MODES or least > 0) and gaps.any():
        wanted = _VERBS[each.mode] if each.mode else f"press with {least:.3g} N or more"
        met = f"touches nothing for {np.count_nonzero(gaps) * timestep:.3g} s"
        yield f"{each.name} should {wanted}", met, gaps
    for index, one in zip(each.pairs, series, strict=True):
        force, turning = one.normal[run], context.net[index].rolling[run]
        if each.mode == "apart" and (pressed := inside & (force > 0)).any():
            met = f"presses with up to {force[pressed].max():.3g} N"
            yield f"{one.name} should be apart", met, pressed
        still = inside & (one.mode[run] == STICK) & (force > 0) & (turning <= TURNING)
        if each.mode == "rolls" and (still := _lasting(still, width)).any():
            met = f"does not turn for {np.count_nonzero(still) * timestep:.3g} s"
            yield f"{one.name} should roll", met, still
        depth = contact_depths(context)[index][1][run]
        if (deep := inside & (depth > each.depth)).any():
            met = f"is up to {depth[deep].max():.3g} m deep"
            yield f"{one.name} should be at most {each.depth:.3g} m deep", met, deep
    mean = _averaged(np.sum([one.normal[run] for one in series], axis=0), judged, width)
    for beyond, worst, bound in (
        (mean < least, np.fmin, f"{least:.3g} N or more"),
        (mean > most, np.fmax, f"{most:.3g} N or less"),
    ):
        if beyond.any():
            met = f"presses with {worst.reduce(mean):.3g} N at worst"
            yield f"{each.name} should press with {bound}", met, beyond


def _inside(context: Context, each: ExpectedContact) -> Mask:
    """Return (n, N) the steps that begin in the window; none in runs that it is not said of."""
    start, stop = np.moveaxis(each.window[:, :, None], 1, 0)
    time = context.trace.time[:, :-1] + _ROUNDING * context.trace.timestep[:, None]
    return (time >= start) & (time < stop)


def _lasting(mask: Mask, shortest: int) -> Mask:
    """Return (N,) where a mask holds for at least so many steps together."""
    found = spans(mask[None])
    lasting = np.zeros(len(mask), np.bool_)
    for start, stop in zip(found.start, found.stop, strict=True):
        lasting[start:stop] = stop - start >= shortest
    return lasting


def _averaged(force: Floats, judged: Mask, width: int) -> Floats:
    """Return (N,) means over `width` steps from each on, or over all of a shorter stretch."""
    means, found = np.full(len(force), np.nan), spans(judged[None])
    for start, stop in zip(found.start.tolist(), found.stop.tolist(), strict=True):
        size = min(width, stop - start)
        total = np.cumsum([0.0, *force[start:stop]])
        means[start : stop - size + 1] = (total[size:] - total[:-size]) / size
    return means


def _lasting_modes(
    mode: NDArray[np.int8], runs: MeasuredRuns
) -> dict[int, list[tuple[int, int, int]]]:
    """Return by run the modes that last, in order, each with its first step and that after it."""
    shortest = np.ceil(runs.limits["mode_hold"] / runs.context.trace.timestep - 1e-6)
    lasting = sorted(
        (run, start, stop, value)
        for value in (STICK, SLIDE)
        for found in [spans(mode == value)]
        for run, start, stop in np.stack([found.run, found.start, found.stop], axis=1).tolist()
        if stop - start >= shortest[run]
    )
    modes: dict[int, list[tuple[int, int, int]]] = {}
    for run, start, stop, value in lasting:
        modes.setdefault(run, []).append((value, start, stop))
    return modes
