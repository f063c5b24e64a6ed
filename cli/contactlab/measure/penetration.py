"""Depth and force of contact between bodies, and labels of sinking, deep and passing bodies."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.rotations import rotate_vectors
from contactlab.contact.trace_arrays import NORMAL, Floats, fast_median
from contactlab.measure.backward_error import resolved_runs
from contactlab.measure.context import (
    Context,
    bodies_beyond,
    bodies_of_pair,
    cached,
    contact_depths,
    count,
    first_step,
    name_of_worst,
    runs_where,
    share,
    worst_pair,
)
from contactlab.measure.entries import MeasuredRuns, Onset, OnsetIterator, Threshold, label, metric
from contactlab.measure.friction import MAX_SPEED_CHANGE, RATE
from contactlab.measure.stick_slip import find_spans
from contactlab.numerical_tolerance import COARSE_ROUNDING
from contactlab.rendering.amounts import format_amount

_PIERCED = Threshold(
    "pierced",
    None,
    "m",
    "On penetration_max of pairs without a fixed surface. By default half the smallest extent of "
    "the pair's thinnest geom, and in planes and height fields for more than 0.1 s.",
)
_STEADY = Threshold(
    "penetration_steady",
    None,
    "m",
    "By default contacts may be as deep as half of the half extent of the pair's thinnest geom; "
    "down to a third of it if one carries one to two times `weights_borne`, and up to two thirds "
    "if their solimp is as wide as that half.",
)


@metric("m", "lower", 1e-9, requires="depth", equivalence=True, heading="depth [m]")
def penetration_max(context: Context) -> Floats:
    """Largest penetration, that is, minus distance, of any contact; not for speculative ones."""
    return worst_pair(context, contact_depths(context)[1].max(axis=-1))


@metric("m", "lower", 1e-9, requires="depth", equivalence=True)
def penetration_mean(context: Context) -> Floats:
    """Penetration of a pair's deepest contact, averaged over the steps in which it touches.

    The worst pair counts. Bands for grasps that can be held in a hand: under 1 mm plausible, over 3
    mm exploited, over 5 mm broken.
    """
    return worst_pair(context, mean_depths(context, np.True_))


def mean_depths(context: Context, inside: NDArray[np.bool_] | np.bool_) -> Floats:
    """Return (R, n) mean depths [m] of pairs over their touching steps (n, N)."""
    touching, depth = contact_depths(context)
    return (depth * inside).sum(axis=-1) / count(touching & inside)


@cached
def steady_depths(context: Context) -> Floats:
    """Return (R, n) mean depths [m] of pairs in the last fifth; NaN unless they rest there."""
    touching, depth = contact_depths(context)
    tail = context.last_fifth
    steps = count(touching[..., tail])
    mean = depth[..., tail].sum(axis=-1) / steps
    # A steady pair must touch in this share of the last fifth; sliding ones hop.
    steady_contact_share = 0.5
    return np.where(share(touching[..., tail]) >= steady_contact_share, mean, np.nan)


@metric("m", "lower", 1e-9, requires="depth", equivalence=True)
def penetration_steady(context: Context) -> Floats:
    """Resting penetration: penetration_mean over the last fifth of the run.

    Only pairs that touch in half of it count, because others bounce. It is compliance, which
    follows from load, mass, solref and solimp, and which a smaller timestep does not reduce.
    """
    return worst_pair(context, steady_depths(context))


@metric("m/s", "lower", 1e-9, tolerance=1e-4, version=2, requires="depth")
def penetration_growth(context: Context) -> Floats:
    """Rate at which resting pairs sink into each other in the last half of the run.

    Median penetration of the last quarter minus that of the third, over a quarter of the run; the
    third quarter's is scaled by the median force of the hardest contact if loads grow. Worst of the
    pairs that touch in 90 % of that half.
    """
    quarter = context.trace.steps // 4
    if quarter == 0:
        return context.undefined()
    return worst_pair(context, _depth_gains(context)) / (quarter * context.trace.timestep)


@cached
def _depth_gains(context: Context) -> Floats:
    return _gains_between(context, 4)[-1]


def _gains_between(context: Context, parts: int) -> list[Floats]:
    """Return (R, n) how much deeper [m] pairs rest in each of the last equal parts of the run.

    The parts are those of the last half; each is compared with the one before it.
    """
    touching, depth = contact_depths(context)
    steps, length = context.trace.steps, context.trace.steps // parts
    starts = [steps - place * length for place in range(parts // 2, 0, -1)]
    resting_share = 0.9  # a pair must touch in this share of the last half to count as resting
    resting = (share(touching[..., starts[0] :]) >= resting_share).nonzero()

    def medians(values: Floats) -> list[Floats]:
        return [fast_median(values[..., start : start + length][resting]) for start in starts]

    depths, gains = medians(depth), []
    loads = medians(context.net.hardest) if context.trace.pairs else depths
    for place in range(1, len(starts)):
        before = depths[place - 1]
        if context.trace.pairs:
            # Contacts do not soften with depth: twice the load makes them at most twice as deep.
            load, later = loads[place - 1 : place + 1]
            before = before * np.where(later > load, later / np.where(load > 0, load, later), 1)
        gains.append(np.full(depth.shape[:2], np.nan))
        gains[-1][resting] = depths[place] - before
    return gains


@metric("1", "lower", 1e-9, kind="detail", requires="depth")
def standoff(context: Context) -> Floats:
    """Distance at which a pair's contacts carry load, over half the extent of the thinner geom.

    Mean positive distance, weighted by normal force; worst pair. Forces below a millionth of the
    weight do not count. Not defined for speculative contacts.
    """
    worst, speculative = (
        worst_pair(context, _relative_standoffs(context)),
        context.setup.speculative,
    )
    return worst if speculative is None else np.where(speculative, np.nan, worst)


def _relative_standoffs(context: Context) -> Floats:
    """Return (R, n) distances of loaded contacts, over half extents of thinner geoms."""
    force, places = context.net.series.normal.mean(axis=-1), context.pairs.places
    shares = context.net.standoff / context.setup.thickness[places, None]
    return np.where(
        force >= COARSE_ROUNDING * context.setup.moving_mass * context.setup.pull, shares, 0
    )


@metric("m", "higher", 1e-9, requires="depth")
def distance_min(context: Context) -> Floats:
    """Least signed distance of any contact in the model; positive if margins never close."""
    touching = context.trace.contacts > 0
    least = np.where(touching, context.trace.least_distance, np.inf).min(axis=1)
    return np.where(touching.any(axis=1), least, np.nan)


@label(
    "bad",
    rank=7,
    thresholds=(_PIERCED,),
    judged_on=(("penetration_max", _PIERCED.name),),
    letter="T",
    colour="#e67818",
    advice="a shorter timestep, thicker geoms, a shorter time constant of solref",
    traits=(
        "no impact",
        "numerical",
    ),
)
def tunneling(runs: MeasuredRuns) -> OnsetIterator:
    """A body's center crossed a surface or a geom, or it overlaps beyond the thinner's middle.

    A dip beyond the middle is accepted as softness if it turns back on its own side within 0.1 s,
    and the run is the motion of its model. At a fixed surface, it is accepted as long as the center
    stays on its side. The reason of the run then describes the dip.
    """
    context, limit = runs.context, runs.limits.get("pierced")
    pierced = [
        (span.run, Onset(span.reason, span.start, bodies_of_pair(context, place)))
        for span in (_iterate_deep_spans(context, limit) if limit else _deep_spans(context))
        if not span.accepted
        for place in (context.pairs.places[span.row],)
    ]
    passed = [
        (run, Onset(f"{passage.mover} passed through {passage.wall}", passage.step, passage.bodies))
        for run, passages in enumerate(context.trace.passages)
        for passage in passages
    ]
    onsets = [*_find_crossings(context), *pierced, *passed]
    yield from sorted(onsets, key=lambda placed: placed[1].step)


@label(
    "bad",
    rank=2,
    thresholds=(
        Threshold(
            "standoff",
            0.5,
            "1",
            "Contacts may carry load as far outside of a geom as they may rest inside of it.",
        ),
    ),
    letter="F",
    colour="#0a79cf",
    advice="margin 0, or gap as large as margin",
)
def contact_at_distance(runs: MeasuredRuns) -> OnsetIterator:
    """A body is carried or pushed by contacts with a margin that keeps it away."""
    for run, part, limit in runs.over("standoff"):
        reason = f"contacts carry load at {part:.3g} of the thinner body's half extent"
        reason = f"{reason} (limit {limit:g})"
        bodies = bodies_beyond(runs.context, _relative_standoffs(runs.context), run, limit)
        yield run, Onset(reason, first_step(runs.context.trace.contacts[run] > 0), bodies)


@label(
    "poor",
    rank=11,
    name="penetration_growth",
    thresholds=(RATE,),
    judged_on=(("penetration_growth", ""),),
    letter="G",
    colour="#681800",
    advice="more load than solref carries: a shorter time constant, or less force",
    traits=("numerical",),
)
def sinking(runs: MeasuredRuns) -> OnsetIterator:
    """A resting pair keeps sinking into each other, at a steady speed, if controls are constant.

    Half of the run is longer than the contact's own time, within which any contact still sinks.
    """
    if runs.context.setup.steered:
        return
    context, limit = runs.context, runs.limits[RATE.name]
    quarter = context.trace.steps // 4 * context.trace.timestep
    if not context.pairs.places or context.trace.steps < 8 or not quarter.all():
        return
    # A settling pair slows down, and one that has just met speeds up.
    early, _, late = _gains_between(context, 8)
    steady = np.abs(early - late) < MAX_SPEED_CHANGE * late
    parts = _depth_gains(context) / quarter / context.setup.thickness[context.pairs.places, None]
    own_time = context.setup.contact_time
    long_enough = True if own_time is None else 2 * quarter >= own_time
    parts = np.where(steady & long_enough, parts, 0)
    worst = worst_pair(context, parts)
    for run in runs_where(worst > limit):
        name = name_of_worst(context, parts, run)
        reason = f"{name} sinks by {worst[run]:.3g} of its half extent a second"
        bodies = bodies_beyond(context, parts, run, limit)
        yield run, Onset(f"{reason} (limit {limit:g})", context.trace.steps // 2, bodies)


@label(
    "poor",
    rank=8,
    thresholds=(_STEADY,),
    letter="P",
    colour="#f6adc7",
    advice="another solref: contactlab MODEL --section contacts --set depth_at_rest='.1 mm'",
)
def deep_penetration(runs: MeasuredRuns) -> OnsetIterator:
    """The resting penetration of a pair exceeds the limit."""
    context, setup, stated_limit = runs.context, runs.context.setup, runs.limits.get(_STEADY.name)
    if context.trace.steps == 0:
        return
    steady, places = steady_depths(context), context.pairs.places
    accepted = np.full(steady.shape, setup.size / 2 if stated_limit is None else stated_limit)
    if stated_limit is None and places:
        loads = _carried_weights(context)[places] / runs.limits[PRESSED.name]
        width, thickness = setup.widths[places, None], setup.thickness[places, None]
        # Divisor of the half extent for the allowed depth of pairs with such a wide solimp.
        soft_divisor = 1.5
        parts = np.where(width < thickness / 2, 2 + np.log2(np.clip(loads, 1, 2)), soft_divisor)
        accepted = thickness / parts
    deep = steady > accepted
    # A pair under a drive must be deep in this share of it to count as resting.
    driven_deep_share = 0.75
    for row in reversed(runs_where(np.asarray(deep.any(axis=1)))):
        depth = contact_depths(context)[1][row, :, context.last_fifth]
        # A pair that a drive presses down for a moment does not rest.
        lasts = share(depth > accepted[row, :, None])
        lasts = lasts >= (driven_deep_share if setup.steered else 0)
        for run in runs_where(deep[row] & lasts & ~_always_overlaps(context, row)):
            name = context.pairs.names[places[row]] if places else "the model"
            limit = accepted[row, run]
            lies, most = format_amount(steady[row, run], "mm"), format_amount(limit, "mm")
            reason = f"{name} rests {lies} deep (limit {most})"
            step = context.last_fifth.start + first_step(depth[run] > limit)
            yield run, Onset(reason, step, bodies_of_pair(context, places[row]) if places else ())


class _DeepSpan(NamedTuple):
    """A time while a pair without a barrier overlaps by more than half the thinner geom."""

    row: int
    run: int
    start: int
    reason: str
    # It is a dip into a soft contact, or an overlap that moves nothing, or the center of the geom
    # stays on its side of a fixed surface.
    accepted: bool


@cached
def _deep_spans(context: Context) -> list[_DeepSpan]:
    return [*_iterate_deep_spans(context, None)]


def _iterate_deep_spans(context: Context, stated_limit: float | None) -> Iterator[_DeepSpan]:
    guarded = {barrier.pair for barrier in context.setup.barriers}
    for row, place in enumerate(context.pairs.places):
        depth, limit = (
            contact_depths(context)[1][row],
            stated_limit or context.setup.thickness[place],
        )
        if depth.max(initial=0) <= limit:
            continue
        where = "" if stated_limit else "its middle, "
        where = f"{where}{format_amount(limit, 'mm')}{'' if stated_limit else ' from the surface'}"
        deep = find_spans(depth > limit)
        for run, start, stop in np.transpose((deep.run, deep.start, deep.stop)).tolist():
            name = context.pairs.names[place]
            lasts = format_amount((stop - start) * context.trace.timestep[run], "ms")
            reason = f"{name} is deeper than {where}, for {lasts}"
            if place in guarded:
                # Its center decides. See _find_crossings.
                yield _DeepSpan(
                    row, run, start, f"{reason}; its center stays outside", accepted=True
                )
            elif stated_limit:
                yield _DeepSpan(row, run, start, reason, accepted=False)
            elif _always_overlaps(context, row)[run]:
                yield _DeepSpan(row, run, start, f"{reason}, and moves nothing", accepted=True)
            else:
                fault = _dip_fault(context, row, run, slice(start, stop))
                why = fault or "and turns back, as its soft contact does"
                yield _DeepSpan(row, run, start, f"{reason}, {why}", accepted=not fault)


def accepted_overlaps(context: Context) -> dict[int, str]:
    """Return the deepest accepted overlap of runs in words, by run."""
    return {span.run: span.reason for span in reversed(_deep_spans(context)) if span.accepted}


def _always_overlaps(context: Context, row: int) -> NDArray[np.bool_]:
    """Return (n,) whether a pair always overlaps and can move neither side, like at a hinge."""
    if context.checks is None or not context.trace.pairs:
        return np.zeros(context.trace.runs, bool)
    depth, squeeze = contact_depths(context)[1][row], context.checks.squeeze
    is_unloaded = np.isnan(squeeze[:, context.pairs.places[row]])
    idle_depth_ratio = 0.9  # smallest ratio of the first to the largest depth of an idle pair
    return is_unloaded & (depth[:, 0] > idle_depth_ratio * depth.max(axis=1))


def _dip_fault(context: Context, row: int, run: int, deep: slice) -> str:
    """Say why a geom beyond the middle does not turn back as its model does; empty if it does."""
    trace, resolved = context.trace, resolved_runs(context)
    index = context.pairs.places[row]
    depth = contact_depths(context)[1][row, run]
    extent, ends = context.setup.thickness[index], [deep.start, min(deep.stop, trace.steps - 1)]
    first, last = trace.pairs[index].slots[run, ends, 0, NORMAL]
    # Depth in half extents that a geom may reach on either side: it may be thin across.
    max_dip_depth = 1.1
    max_dip_steps = 2  # it must turn back within these steps; pads that sink in stay longer
    brief = deep.stop - deep.start <= max_dip_steps and depth[deep].max() < max_dip_depth * extent
    if deep.start == 0:
        return "from the start"
    max_dip_seconds = 0.1  # longest dip [s] of a geom beyond its middle
    if (deep.stop - deep.start) * trace.timestep[run] > max_dip_seconds:
        return f"longer than a dip into a soft contact ({format_amount(max_dip_seconds, 'ms')})"
    if deep.stop < trace.steps and depth[deep.stop] == 0:
        return "and leaves it at once, not by way of the surface"
    if not (brief or first @ last > 0):
        return "and leaves on the other side"
    if resolved is None or not resolved[run]:
        return "a dip that is not known to be the motion of the model"
    return ""


def _find_crossings(context: Context) -> OnsetIterator:
    """Find the first step with the center of a stopped geom beyond a barrier's mid-plane."""
    for barrier in context.setup.barriers:
        place = context.position(barrier.body)
        if barrier.centre.any():
            turned = barrier.body.qpos + 3
            rotation = context.trace.qpos[:, :, turned : turned + 4]
            place = place + rotate_vectors(rotation, barrier.centre)
        height = np.full(place.shape[:2], -float(barrier.point @ barrier.normal))
        for axis in np.flatnonzero(barrier.normal).tolist():
            height += place[:, :, axis] * barrier.normal[axis]
        changed = np.diff(height >= 0, axis=1)
        reason = (
            f"{barrier.body.name} passed the mid-plane of {context.trace.pairs[barrier.pair].name}"
        )
        for run in runs_where(np.asarray(changed.any(axis=1))):
            steps = np.flatnonzero(changed[run])
            position = place[run]
            over = height[run]
            share = (over[steps] / (over[steps] - over[steps + 1]))[:, None]
            crossing = position[steps] + share * (position[steps + 1] - position[steps])
            offset = crossing - barrier.point
            offset -= (offset @ barrier.normal)[:, None] * barrier.normal
            inside = steps[np.linalg.norm(offset, axis=1) < barrier.reach]
            if len(inside):
                yield run, Onset(reason, int(inside[0]), (barrier.body.name,))


PRESSED = Threshold(
    "weights_borne",
    10.0,
    "1",
    "Weight is a tenth of the pressing force; and contact alone, after a while, presses at least "
    "half as hard.",
)


def _lighter_weights(context: Context) -> Floats:
    """Return (P, n) the weight of the lighter side of each pair [N]."""
    return context.setup.masses[:, None] * context.setup.pull


@cached
def _carried_weights(context: Context) -> Floats:
    """Return (P, n) the median of each pair's normal force in the last fifth, in weights."""
    forces = fast_median(context.net.series.normal[..., context.last_fifth])
    weights = forces[context.pairs.rows] / _lighter_weights(context)
    max_weights = 1e9  # larger loads in weights occur only along directions without joint motion
    return weights * (weights < max_weights)


@metric("1", "lower", 1e-6, kind="detail")
def weights_borne(context: Context) -> Floats:
    """Median normal force of a pair in the last fifth over the weight of the lighter side, worst.

    Weights are those of the body trees of the pair's sides; without gravity, the force that moves
    them by a mean size in a tenth of a second squared. Not defined under a drive that keeps
    changing the controls.
    """
    return (
        context.undefined()
        if context.setup.steered
        else worst_pair(context, _carried_weights(context))
    )


@label(
    "poor",
    rank=9,
    thresholds=(PRESSED,),
    letter="Q",
    colour="#c076b1",
    advice="start bodies apart: they overlap in the keyframe, or are closed onto each other",
)
def squeezed(runs: MeasuredRuns) -> OnsetIterator:
    """Bodies at rest press each other with many times their weight, only because they overlap."""
    context, checks = runs.context, runs.context.checks
    if checks is None:
        return
    min_squeeze_share = 0.5
    for run, _, limit in runs.over(PRESSED.name):
        carried = _carried_weights(context)[:, run]
        alone = (
            checks.squeeze[run] / _lighter_weights(context)[:, run] >= min_squeeze_share * carried
        )
        for pair in runs_where(alone & (carried > limit)):
            amount = f"{carried[pair]:.3g} times the weight of the lighter (limit {limit:g})"
            reason = f"{context.pairs.names[pair]} is squeezed by {amount}"
            yield run, Onset(reason, context.last_fifth.start, bodies_of_pair(context, pair))
