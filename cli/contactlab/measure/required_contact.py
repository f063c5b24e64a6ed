"""The labels of pairs that do not touch as their scene or sweep says that they must."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import NO_CONTACT, SLIDE, STICK, Floats
from contactlab.contact.trace_setup import ExpectedContact
from contactlab.measure.context import Context, contact_depths, first_step, runs_where
from contactlab.measure.coverage import TURNING
from contactlab.measure.entries import Found, MeasuredRuns, Onset, Threshold, label
from contactlab.measure.stick_slip import spans

_VERBS = {"sticks": "stick", "slides": "slide", "rolls": "roll"}
MODE_HOLD = Threshold(
    "mode_hold", 0.02, "s", "Shortest that counts; sliding is told from sticking in 4 to 24 ms."
)
_ROUNDING = 1e-6  # Share of a step by which a time may miss the start of a step

Mask = NDArray[np.bool_]
Faults = Iterator[tuple[str, str, Mask]]
"""What is required, what is met instead, and the steps (N,) in which it is met."""


@label(
    "noted",
    rank=4,
    thresholds=(MODE_HOLD,),
    letter="Z",
    colour="#995c94",
    advice="more friction; or priority, if the other geom's should count",
    traits=("required",),
)
def unexpected_slide(runs: MeasuredRuns) -> Found:
    """A pair slides that must stick or roll."""
    return _found(runs, SLIDE)


@label(
    "noted",
    rank=3,
    thresholds=(MODE_HOLD,),
    letter="Y",
    colour="#3d5631",
    advice="less friction on both geoms, since the larger counts; or priority",
    traits=("required",),
)
def unexpected_stick(runs: MeasuredRuns) -> Found:
    """A pair sticks that must slide."""
    return _found(runs, STICK)


@label(
    "noted",
    rank=5,
    thresholds=(MODE_HOLD,),
    letter="5",
    colour="#b3d789",
    advice="`must` says what has to hold: mend the model, or what is required of it",
    traits=("required",),
)
def pair_expectation(runs: MeasuredRuns) -> Found:
    """A pair does not press, touch, part or roll as it must, or is deeper."""
    return _found(runs, NO_CONTACT)


def _found(runs: MeasuredRuns, mode: int) -> Found:
    """Find what pairs do unexpectedly: slide, stick, or anything else."""
    context, hold = runs.context, runs.limits["mode_hold"]
    for expectation in context.setup.expected:
        if not (isinstance(expectation, ExpectedContact) and expectation.pairs):
            continue
        start, stop = np.moveaxis(expectation.window[:, :, None], 1, 0)
        time = context.trace.time[:, :-1] + _ROUNDING * context.trace.timestep[:, None]
        inside = (time >= start) & (time < stop)
        for run in runs_where(inside.any(axis=1) & _may_fail(context, expectation, mode)):
            width = max(int(np.ceil(hold / context.trace.timestep[run] - _ROUNDING)), 1)
            found = (
                _misfits(context, expectation, run, inside[run], width)
                if mode == NO_CONTACT
                else _wrong_modes(context, expectation, run, inside[run], width, mode)
            )
            for wanted, met, where in found:
                step = first_step(where)
                reason = f"{wanted}, but {met}, from {context.trace.time[run, step]:.4g} s on"
                yield run, Onset(reason, step)


def _may_fail(context: Context, expectation: ExpectedContact, mode: int) -> Mask | bool:
    """Return (n,) which runs meet a mode that must not be, or whether more than a mode is said."""
    if mode == NO_CONTACT:
        return expectation.end is None
    modes = context.net.series.mode[context.pairs.rows[[*expectation.pairs]]]
    forbidden = expectation.word in ({"slides"} if mode == STICK else {"sticks", "rolls"})
    return forbidden & np.logical_or.reduce((modes == mode).any(axis=2))


def _wrong_modes(
    context: Context, expectation: ExpectedContact, run: int, inside: Mask, width: int, met: int
) -> Faults:
    series, when = context.net.series, expectation.end or ""
    rows = context.pairs.rows[[*expectation.pairs]].tolist()
    for pair, row in zip(expectation.pairs, rows, strict=True):
        mode = series.mode[row, run]
        bad = lasting(inside & (mode == met), width)
        good = np.flatnonzero(lasting(inside & (mode == STICK + SLIDE - met), width)).tolist()
        first, last = (good[0], good[-1]) if good else (None, None)
        parts = {"first": slice(first), "last": slice(last, None), "": slice(None)}
        where = np.zeros_like(bad)
        where[parts[when]] = bad[parts[when]]
        if where.any():
            slides = f"slides, at up to {series.slip[row, run, where].max():.3g} m/s"
            does = slides if met == SLIDE else "sticks"
            verb = _VERBS[expectation.word]
            yield f"{context.pairs.names[pair]} should {verb} {when}".rstrip(), does, where


def _misfits(
    context: Context, expectation: ExpectedContact, run: int, inside: Mask, width: int
) -> Faults:
    timestep, (least, most) = float(context.trace.timestep[run]), expectation.force
    word = expectation.word
    rows = context.pairs.rows[[*expectation.pairs]]
    series, depths = context.net.series, contact_depths(context)[1]
    touching = inside & (series.mode[rows, run] != NO_CONTACT).any(axis=0)
    apart = lasting(inside & ~touching, width) & (expectation.timed or not touching.any())
    if (word in _VERBS or least > 0) and apart.any():
        wanted = _VERBS.get(word, f"press with {least:.3g} N or more")
        met = f"touches nothing for {np.count_nonzero(apart) * timestep:.3g} s"
        yield f"{expectation.name} should {wanted}", met, apart
    for pair, row in zip(expectation.pairs, rows.tolist(), strict=True):
        name, force, depth = context.pairs.names[pair], series.normal[row, run], depths[row, run]
        if word == "apart" and (pressed := inside & (force > 0)).any():
            met = f"presses with up to {force[pressed].max():.3g} N"
            yield f"{name} should be apart", met, pressed
        still = inside & (force > 0) & (context.net.rolling[row, run] <= TURNING)
        still = lasting(still & (series.mode[row, run] == STICK), width)
        if word == "rolls" and still.any():
            met = f"does not turn for {np.count_nonzero(still) * timestep:.3g} s"
            yield f"{name} should roll", met, still
        if (deep := inside & (depth > expectation.depth)).any():
            met = f"is up to {depth[deep].max():.3g} m deep"
            yield f"{name} should be at most {expectation.depth:.3g} m deep", met, deep
    total = np.sum([series.normal[row, run] for row in rows], axis=0)
    mean = _averaged(total, inside if expectation.timed else touching, width)
    for beyond, worst, bound in (
        (mean < least, np.fmin, f"{least:.3g} N or more"),
        (mean > most, np.fmax, f"{most:.3g} N or less"),
    ):
        if beyond.any():
            met = f"presses with {worst.reduce(mean):.3g} N at worst"
            yield f"{expectation.name} should press with {bound}", met, beyond


def lasting(mask: Mask, shortest: int) -> Mask:
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
