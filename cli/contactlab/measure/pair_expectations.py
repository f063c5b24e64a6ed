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
_MODE_HOLD = Threshold(
    "mode_hold", 0.02, "s", "Shortest that counts; sliding is told from sticking in 4 to 24 ms."
)
_ROUNDING = 1e-6  # Share of a step by which a time may miss the start of a step

Mask = NDArray[np.bool_]
Faults = Iterator[tuple[str, str, Mask]]
"""What was expected, what is met instead, and the steps (N,) in which it is."""


@label(24, (_MODE_HOLD,))
def unexpected_slide(runs: MeasuredRuns) -> Found:
    """A pair slides that is expected to stick or to roll."""
    return _found(runs, SLIDE)


@label(20, (_MODE_HOLD,))
def unexpected_stick(runs: MeasuredRuns) -> Found:
    """A pair sticks that is expected to slide."""
    return _found(runs, STICK)


@label(26, (_MODE_HOLD,))
def pair_expectation(runs: MeasuredRuns) -> Found:
    """A pair does not press, touch, part or roll as expected, or is deeper."""
    return _found(runs, NO_CONTACT)


def _found(runs: MeasuredRuns, mode: int) -> Found:
    """Find what pairs do unexpectedly: slide, stick, or anything else."""
    context, hold = runs.context, runs.limits["mode_hold"]
    for each in filter(lambda each: each.pairs, context.setup.expected):
        start, stop = np.moveaxis(each.window[:, :, None], 1, 0)
        time = context.trace.time[:, :-1] + _ROUNDING * context.trace.timestep[:, None]
        inside = (time >= start) & (time < stop)
        for run in runs_where(np.asarray(inside.any(axis=1))):
            width = max(int(np.ceil(hold / context.trace.timestep[run] - _ROUNDING)), 1)
            found = (
                _misfits(context, each, run, inside[run], width)
                if mode == NO_CONTACT
                else _wrong_modes(context, each, run, inside[run], width, mode)
            )
            for wanted, met, where in found:
                step = first_step(where)
                reason = f"{wanted}, but {met}, from {context.trace.time[run, step]:.4g} s on"
                yield run, Finding(reason, step)


def _wrong_modes(
    context: Context, each: ExpectedContact, run: int, inside: Mask, width: int, met: int
) -> Faults:
    modes = {"slide": STICK} if met == STICK else {"stick": SLIDE, "rolls": SLIDE}
    ends = (("first", each.first), ("last", each.last), ("", each.mode))
    wanted = [(when, mode) for when, mode in ends if mode in modes]
    for series in [context.series[index] for index in each.pairs] if wanted else ():
        mode = series.mode[run]
        bad = _lasting(inside & (mode == met), width)
        good = np.flatnonzero(_lasting(inside & (mode == STICK + SLIDE - met), width)).tolist()
        first, last = (good[0], good[-1]) if good else (None, None)
        parts = {"first": slice(first), "last": slice(last, None), "": slice(None)}
        for when, what in wanted:
            where = np.zeros_like(bad)
            where[parts[when]] = bad[parts[when]]
            if where.any():
                slides = f"slides, at up to {series.slip[run, where].max():.3g} m/s"
                does = slides if met == SLIDE else "sticks"
                yield f"{series.name} should {_VERBS[what]} {when}".rstrip(), does, where


def _misfits(context: Context, each: ExpectedContact, run: int, inside: Mask, width: int) -> Faults:
    timestep, (least, most) = float(context.trace.timestep[run]), each.force
    series = [context.series[index] for index in each.pairs]
    touching = inside & np.any([one.mode[run] != NO_CONTACT for one in series], axis=0)
    apart = _lasting(inside & ~touching, width) & (each.timed or not touching.any())
    if (each.mode in {"stick", "slide", "rolls"} or least > 0) and apart.any():
        wanted = _VERBS[each.mode] if each.mode else f"press with {least:.3g} N or more"
        met = f"touches nothing for {np.count_nonzero(apart) * timestep:.3g} s"
        yield f"{each.name} should {wanted}", met, apart
    for index, one in zip(each.pairs, series, strict=True):
        force, depth = one.normal[run], contact_depths(context)[index][1][run]
        if each.mode == "apart" and (pressed := inside & (force > 0)).any():
            met = f"presses with up to {force[pressed].max():.3g} N"
            yield f"{one.name} should be apart", met, pressed
        still = inside & (force > 0) & (context.net[index].rolling[run] <= TURNING)
        still = _lasting(still & (one.mode[run] == STICK), width)
        if each.mode == "rolls" and still.any():
            met = f"does not turn for {np.count_nonzero(still) * timestep:.3g} s"
            yield f"{one.name} should roll", met, still
        if (deep := inside & (depth > each.depth)).any():
            met = f"is up to {depth[deep].max():.3g} m deep"
            yield f"{one.name} should be at most {each.depth:.3g} m deep", met, deep
    total = np.sum([one.normal[run] for one in series], axis=0)
    mean = _averaged(total, inside if each.timed else touching, width)
    for beyond, worst, bound in (
        (mean < least, np.fmin, f"{least:.3g} N or more"),
        (mean > most, np.fmax, f"{most:.3g} N or less"),
    ):
        if beyond.any():
            met = f"presses with {worst.reduce(mean):.3g} N at worst"
            yield f"{each.name} should press with {bound}", met, beyond


def _lasting(mask: Mask, shortest: int) -> Mask:
    """Return (N,) where a mask holds for at least so many steps together."""
    found, lasting = spans(mask[None]), mask.copy()
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
