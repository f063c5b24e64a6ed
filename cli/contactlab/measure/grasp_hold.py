"""A body that should be held: metrics over its hold window, and their labels.

Runs that end more than a step before the end of their hold window are not measured.
"""

from collections.abc import Iterator

import numpy as np

from contactlab.contact.rotations import rotate_vectors
from contactlab.contact.trace_arrays import (
    FORCE,
    LINEAR_VELOCITY,
    NORMAL,
    TANGENT,
    Floats,
    HeldPose,
    PairTrace,
    sum_of_slots,
)
from contactlab.measure.backward_error import TOLERANCE
from contactlab.measure.context import (
    Context,
    bearing,
    bodies_of_pair,
    cached,
    contact_depths,
    count,
    down,
    first_step,
    hold_seconds,
    hold_window,
    runs_where,
    worst_pair,
)
from contactlab.measure.entries import MeasuredRuns, Onset, OnsetIterator, Threshold, label, metric
from contactlab.measure.friction import hold_switch_masks
from contactlab.measure.penetration import mean_depths
from contactlab.rendering.amounts import format_amount, format_percent

_EXPLOITED = Threshold(
    "exploited",
    None,
    "m",
    "On hold_penetration. By default half of the thinner geom's half extent, as at rest.",
)
_BROKEN = Threshold(
    "broken", None, "m", "On hold_penetration. By default the thinner geom's half extent."
)
_HOLD_SLIP = Threshold(
    "hold_slip", None, "m", "By default the tolerance times the smaller geom's greatest extent."
)
_HOLD_OFFSET = Threshold("hold_offset", None, "m", "Set it if the subject begins in its grip.")


@metric("1/s", "lower", tolerance=5.0, equivalence=True)
def hold_switches(context: Context) -> Floats:
    """Changes of a pair's mode over the hold window, worst pair.

    As in mode_switches; also each time that a sticking pair loses or regains its contact.
    """
    return worst_pair(context, count(hold_switch_masks(context)) / hold_seconds(context))


@metric("m", "lower", 1e-9, requires="depth", equivalence=True, heading="hold depth [m]")
def hold_penetration(context: Context) -> Floats:
    """Penetration as in penetration_mean, with its bands, over the hold window only."""
    return worst_pair(context, mean_depths(context, hold_window(context)))


@metric("m", "lower", 1e-9, equivalence=True, heading="hold slip [m]")
def hold_slip(context: Context) -> Floats:
    """Farthest slip of a pair within the hold window, worst pair.

    Its tangential velocity, weighted by normal force, summed in the world frame: jitter cancels.
    """
    return worst_pair(context, _hold_slips(context))


@cached
def _hold_slips(context: Context) -> Floats:
    """Return (R, n) the slip [m] of pairs within the hold window; empty without one."""
    inside = hold_window(context)
    steps = np.flatnonzero(inside.any(axis=0))
    if not len(steps):
        return np.empty((0, context.trace.runs))
    part = slice(int(steps[0]), int(steps[-1]) + 1)
    pairs = [context.trace.pairs[place] for place in context.pairs.places]
    slips = [_slip_velocity(pair, part) * inside[:, part, None] for pair in pairs]
    timestep = context.trace.timestep[:, None, None]
    paths = [np.cumsum(slip * timestep, axis=1) for slip in slips]
    farthest = [np.sqrt((path * path).sum(axis=2).max(axis=1)) for path in paths]
    return np.where(inside.any(axis=1), np.reshape(farthest, (-1, context.trace.runs)), np.nan)


@metric("m", resolution=1e-9)
def hold_drop(context: Context) -> Floats:
    """Distance that the subject sinks from its holder in the hold window; negative if it rises."""
    held_pose, inside = context.trace.held_pose, hold_window(context)
    if held_pose is None:
        return context.undefined()
    run = np.arange(context.trace.runs)
    first = inside.argmax(axis=1)
    last = inside.shape[1] - 1 - inside[:, ::-1].argmax(axis=1)
    moved = rotate_vectors(
        held_pose.rotation[run, last],
        held_pose.position[run, last] - held_pose.position[run, first],
    )
    return np.where(inside.any(axis=1), (moved * down(context)).sum(axis=1), np.nan)


@metric("m", "lower", 1e-9)
def hold_offset(context: Context) -> Floats:
    """Farthest distance of the subject in the hold window from its first position in its holder."""
    held_pose, inside = context.trace.held_pose, hold_window(context)
    if held_pose is None:
        return context.undefined()
    farthest = np.where(inside, _hold_offsets(held_pose), 0).max(axis=1)
    return np.where(inside.any(axis=1), farthest, np.nan)


@metric("1", "higher")
def hold_contact(context: Context) -> Floats:
    """Share of the steps of the hold window in which a monitored pair carries force."""
    inside = hold_window(context)
    if not context.trace.pairs:
        return context.undefined()
    steps = count(inside)
    return count(bearing(context).any(axis=0) & inside) / np.where(steps > 0, steps, np.nan)


@label(
    "poor",
    rank=10,
    thresholds=(_EXPLOITED,),
    judged_on=(("hold_penetration", _EXPLOITED.name),),
    letter="X",
    colour="#6fc3fe",
    advice="a shorter time constant of solref, and impratio 10 with an elliptic cone",
    traits=("grip",),
)
def exploited(runs: MeasuredRuns) -> OnsetIterator:
    """The grip relies on penetration that no solid body allows."""
    return _find_deep_pairs(runs, "exploited", 2)


@label(
    "bad",
    rank=8,
    thresholds=(_BROKEN,),
    judged_on=(("hold_penetration", _BROKEN.name),),
    letter="B",
    colour="#ea89ca",
    advice="a shorter time constant of solref, solimp nearer 1, or less grip force",
    traits=(
        "grip",
        "no impact",
    ),
)
def broken(runs: MeasuredRuns) -> OnsetIterator:
    """The penetration of a grip is so deep that its contact is meaningless."""
    return _find_deep_pairs(runs, "broken", 1)


@label(
    "poor",
    rank=3,
    thresholds=(
        _HOLD_SLIP,
        _HOLD_OFFSET,
        Threshold("hold_contact", 0.5, "1", "A minimum: a held body touches most of the time."),
        TOLERANCE,
    ),
    judged_on=tuple((name, name) for name in ("hold_slip", "hold_offset", "hold_contact")),
    letter="S",
    colour="#2c077d",
    advice="more friction or grip; if it creeps, an elliptic cone with impratio 10",
    traits=("grip",),
)
def slipping(runs: MeasuredRuns) -> OnsetIterator:
    """A body that should be held slips, leaves its place, or carries no force."""
    window, held_pose = hold_window(runs.context), runs.context.trace.held_pose
    share, seconds = runs.metrics["hold_contact"], hold_seconds(runs.context)
    for run in runs_where(share < runs.limits["hold_contact"]):
        reason = f"no contact carried force in {format_percent(1 - share[run])} of the hold time"
        yield run, Onset(reason, first_step(window[run]))
    for run, offset, limit in runs.over("hold_offset"):
        assert held_pose is not None
        reason = f"it was {format_amount(offset, 'mm')} from its place in the grip in the hold time"
        step = first_step(_hold_offsets(held_pose)[run] > limit)
        yield run, Onset(f"{reason} (limit {format_amount(limit, 'mm')})", step)
    reaches = runs.context.setup.reaches[runs.context.pairs.places]
    limits = _row_limits(runs, _HOLD_SLIP.name, runs.limits[TOLERANCE.name] * reaches)
    for run, row, slip in _amounts_beyond(_hold_slips(runs.context), limits):
        name, bodies = _name_and_bodies(runs.context, row)
        way, most = format_amount(slip, "mm"), format_amount(limits[row], "mm")
        reason = f"{name} slipped {way} in {seconds[run]:.3g} s (limit {most})"
        yield run, Onset(reason, first_step(window[run]), bodies)


def _find_deep_pairs(runs: MeasuredRuns, threshold: str, parts: int) -> OnsetIterator:
    """Find pairs that are deeper during the hold than a limit, or than a part of a half extent."""
    context, inside = runs.context, hold_window(runs.context)
    limits = _row_limits(runs, threshold, context.setup.thickness[context.pairs.places] / parts)
    for run, row, depth in _amounts_beyond(mean_depths(context, inside), limits):
        name, bodies = _name_and_bodies(context, row)
        step = first_step((contact_depths(context)[1][row, run] > limits[row]) & inside[run])
        deep, most = format_amount(depth, "mm"), format_amount(limits[row], "mm")
        reason = f"{name} is {deep} deep on average (limit {most})"
        yield run, Onset(reason, step, bodies)


def _row_limits(runs: MeasuredRuns, threshold: str, shares: Floats) -> Floats:
    """Return (R,) the limit of each row of pairs: the threshold, or a share of its size."""
    return np.broadcast_to(runs.limits.get(threshold, shares), shares.shape)


def _amounts_beyond(amounts: Floats, limits: Floats) -> Iterator[tuple[int, int, float]]:
    """Yield runs, rows and amounts (R, n) beyond limits (R,), for each run the farthest first."""
    parts = amounts / limits[:, None] if len(amounts) else amounts
    for run in range(amounts.shape[1]):
        for row in np.argsort(-parts[:, run]).tolist():
            if parts[row, run] > 1:
                yield run, row, float(amounts[row, run])


def _name_and_bodies(context: Context, row: int) -> tuple[str, tuple[str, ...]]:
    place = context.pairs.places[row]
    return context.pairs.names[place], bodies_of_pair(context, place)


def _hold_offsets(held_pose: HeldPose) -> Floats:
    """Return (n, N) the distance [m] of the subject from its start position in its holder."""
    moved = held_pose.position - held_pose.position[:, :1]
    return np.sqrt((moved * moved).sum(axis=2))


def _slip_velocity(pair: PairTrace, part: slice) -> Floats:
    """Return (n, W, 3) the slip velocity [m/s] of a pair, weighted by normal force, world frame."""
    slots = pair.slots[:, part]
    tangent = slots[..., TANGENT]
    across = np.cross(slots[..., NORMAL], tangent)
    _, first, second = np.moveaxis(slots[..., LINEAR_VELOCITY], -1, 0)
    force = slots[..., FORCE.start, None]
    slip = force * (first[..., None] * tangent + second[..., None] * across)
    slip, total = sum_of_slots(slip, axis=2), sum_of_slots(force, axis=2)
    return slip / np.where(total > 0, total, np.inf)
