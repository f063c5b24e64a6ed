"""Friction: slip, creep, cone limits, and chatter.

A pair chatters if it keeps losing its contact, or switching between stick and slide. A pair that
sticks well inside its friction bound has no reason to separate: if it loses all its contacts and
regains them, over and over, the contact is too stiff or too weakly damped for its timestep. Sliding
bodies hop too, but at the bound; bodies that bounce to rest touch less hard every time.
"""

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import (
    FORCE,
    LINEAR_VELOCITY,
    NO_CONTACT,
    SLIDE,
    STICK,
    TORQUE,
    Floats,
    fast_median,
    squared_lengths,
)
from contactlab.measure.backward_error import resolved_runs
from contactlab.measure.context import (
    Context,
    bearing,
    bodies_beyond,
    bodies_of_pair,
    cached,
    count,
    hold_seconds,
    hold_window,
    name_of_worst,
    runs_where,
    share,
    worst_pair,
)
from contactlab.measure.entries import MeasuredRuns, Onset, OnsetIterator, Threshold, label, metric
from contactlab.measure.stick_slip import HELD_USAGE, IMPACT, Spans, find_spans, mode_changes
from contactlab.rendering.amounts import format_above, format_amount, format_percent

_CREEP_SPEED = Threshold("creep_speed", None, "m/s", "Set it if sticking bodies should stay.")
RATE = Threshold(
    "creep_rate",
    0.03,
    "1/s",
    "Sizes of a body per second: a body that creeps, sinks or yields by a tenth of its size in the "
    "3 s of an ordinary task does not rest.",
)
_MODE_SWITCHES = Threshold(
    "mode_switches",
    5,
    "1/s",
    "Guideline for a pad that does not chatter; also on contact_losses.",
)
_MIN_EVENTS = Threshold(
    "mode_switch_count", 3, "1", "Fewest events of chatter: a stop and a start are not chatter."
)
_SCENE_THRESHOLDS = {"creep_speed", "drift", "rest_speed"}  # thresholds of scenes that define rest
MAX_SPEED_CHANGE = 0.2  # largest relative change of the speed of steady creep or sinking
Events = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Runs and steps of events, in order of run and time."""


@cached
def switch_masks(context: Context) -> NDArray[np.bool_]:
    """Return (R, n, N - 1) the steps with a change of pairs between stick and slide."""
    series = context.net.series
    masks = np.zeros(series.mode[..., 1:].shape, np.bool_)
    for row in runs_where((series.mode == SLIDE).any(axis=(1, 2))):
        masks[row] = mode_changes(series.mode[row], series.normal[row], series.usage[row])
    return masks


@metric("1/s", "lower", tolerance=5.0, version=2, equivalence=True, heading="switches/s")
def mode_switches(context: Context) -> Floats:
    """Changes between stick and slide over simulated time, worst pair.

    From net force and force-weighted slip, with hysteresis, and gaps of up to 100 ms bridged.
    Sticking that never uses less than 0.9 of the friction bound counts as slow sliding. A pad
    with more than 5 a second chatters.
    """
    return worst_pair(context, count(switch_masks(context)) / context.seconds)


@metric("m", resolution=1e-9, version=2, equivalence=True)
def slip_distance(context: Context) -> Floats:
    """Slip speed summed over the time in which the pair sticks or slides, worst pair.

    On hops of up to 100 ms between contacts it is interpolated between the neighboring speeds.
    """
    # Slip speeds of pairs, interpolated on their hops.
    slip = context.net.series.slip
    hops = (context.net.series.mode != NO_CONTACT) & ~bearing(context)
    if hops.any():
        slip = slip.copy()
        for place in map(tuple, np.argwhere(hops.any(axis=-1))):
            touching, gaps = np.flatnonzero(bearing(context)[place]), np.flatnonzero(hops[place])
            slip[place][gaps] = np.interp(gaps, touching, slip[place][touching])
    return worst_pair(context, slip.sum(axis=-1)) * context.trace.timestep


@metric("m/s", "lower", 1e-9, tolerance=1e-4)
def creep_speed(context: Context) -> Floats:
    """Mean slip speed of a sticking pair over the last fifth of the run, worst pair.

    Averaged over the steps in which it carries force. Soft contact creeps under any tangential
    load, at (1 - d0) / (d0 impratio b N) times the acceleration that load would cause.
    """
    return worst_pair(context, _creep_speeds(context))


@cached
def _creep_speeds(context: Context) -> Floats:
    series, last = context.net.series, context.last_fifth
    sticking = (series.mode[..., last] == STICK) & bearing(context)[..., last]
    return (series.slip[..., last] * sticking).sum(axis=-1) / count(sticking)


@metric("1/s", "lower", 1e-9, version=2, kind="detail")
def crept(context: Context) -> Floats:
    """Creep speed of sticking bodies, over their size.

    Median slip of pairs that stick through the last half, by less than 0.9 of the friction bound,
    and neither roll nor slow down. Each pair counts over the greatest extent of its smaller geom;
    all pairs together count, up to the distance that a free body moves, over twice its reach. Not
    defined under changing controls, nor if a surface moves relative to its geom, like a belt's.
    """
    moved = context.setup.steered or context.setup.conveying
    shares = [] if moved else [*_creep_shares(context).values()]
    return worst_pair(context, shares)


@cached
def _creep_shares(context: Context) -> dict[str, Floats]:
    """Return (n,) the creep speed of each pair, and of each free body, over its size."""
    steps, mechanism, pairs = context.trace.steps, context.setup.mechanism, context.pairs
    half, late = slice(steps // 2, None), slice(3 * steps // 4, None)
    series, extents = context.net.series, context.setup.thickness[pairs.places, None, None]
    usage, slip = series.usage[..., half], series.slip[..., half]
    is_held = (series.mode[..., half] == STICK) & (usage > 0) & (usage < HELD_USAGE)
    is_held &= context.net.rolling[..., half] * extents <= slip  # A rolling body leaves the spot.
    speed = fast_median(series.slip[..., late])
    # A settling pair slows down.
    before = fast_median(series.slip[..., half.start : late.start])
    steady = (np.abs(before - speed) < MAX_SPEED_CHANGE * speed) & (share(is_held) > 0.9)
    ways = (steady * speed)[pairs.rows]
    shares = dict(zip(pairs.names, ways / context.setup.reaches[:, None], strict=True))
    together = sum(ways, np.zeros(context.trace.runs))
    joints = {joint.place: joint for joint in mechanism.joints} if mechanism else {}
    for body in context.setup.free_bodies:
        place = context.position(body)
        moved = np.sqrt(squared_lengths(place[:, -1] - place[:, late.start]))
        moved = moved / np.maximum(context.seconds / 4, np.finfo(float).tiny)
        size = 2 * joints[body.qpos].reach if joints else np.inf
        shares[body.name] = np.minimum(moved, together) / size
    return shares


@metric("1", "lower", 1e-6, version=2)
def cone_violation(context: Context) -> Floats:
    """Share by which contact forces exceed their cone, except the worst hundredth of contacts.

    By the 2-norm if the cone is elliptic, and the 1-norm if not.
    """
    return worst_pair(context, context.net.excess)


@metric("J", "lower", 1e-12)
def complementarity(context: Context) -> Floats:
    """Largest product of a contact's normal force and its positive distance, with margins."""
    return worst_pair(context, context.net.detached)


@metric("N s", resolution=1e-9, equivalence=True)
def normal_impulse(context: Context) -> Floats:
    """Net normal force summed over time, largest of all pairs; at rest it is weight times time."""
    return worst_pair(context, context.net.series.normal.sum(axis=-1)) * context.trace.timestep


@label(
    "poor",
    rank=1,
    thresholds=(_CREEP_SPEED, RATE),
    judged_on=((_CREEP_SPEED.name, _CREEP_SPEED.name), ("crept", RATE.name)),
    letter="R",
    colour="#480f50",
    advice="an elliptic cone with impratio 10, or a shorter time constant of solref",
)
def creep(runs: MeasuredRuns) -> OnsetIterator:
    """A sticking pair slips faster than the scene accepts; or far for its size, if none is set."""
    for run, speed, limit in runs.over("creep_speed"):
        name = name_of_worst(runs.context, _creep_speeds(runs.context), run)
        slips, most = format_amount(speed, "mm/s"), format_amount(limit, "mm/s")
        reason = f"{name} sticks, but slips at {slips} (limit {most})"
        bodies = bodies_beyond(runs.context, _creep_speeds(runs.context), run, limit)
        yield run, Onset(reason, runs.context.last_fifth.start, bodies)
    is_judged = not _SCENE_THRESHOLDS.isdisjoint(runs.context.setup.thresholds)
    for run, way, limit in () if is_judged else runs.over("crept", RATE.name):
        crept = _creep_shares(runs.context)
        name = max(crept, key=lambda pair: np.nan_to_num(crept[pair][run]))
        reason = f"{name} sticks, but creeps by {format_above(way, limit)} of its size a second"
        reason = f"{reason} (limit {format_percent(limit)})"
        far = (part for part, ways in crept.items() if ways[run] > limit)
        bodies = dict.fromkeys(body for part in far for body in _bodies_of_part(runs.context, part))
        yield run, Onset(reason, runs.context.last_fifth.start, tuple(bodies))


def _bodies_of_part(context: Context, part: str) -> tuple[str, ...]:
    names = context.pairs.names
    return bodies_of_pair(context, names.index(part)) if part in names else (part,)


@metric("1/s", "lower", tolerance=5.0)
def contact_losses(context: Context) -> Floats:
    """Rate at which a sticking pair loses all contact and regains it; worst pair.

    Counted are gaps no longer than the contact before, with less than 0.9 of the friction bound in
    use on both sides, after which the pair meets as hard as before, as fast as after a fall of 5
    ms. A pad with more than 5 a second chatters.
    """
    counts = np.zeros((len(context.pairs.places), context.trace.runs))
    for row, gaps in _all_lost_contacts(context).items():
        counts[row] = np.bincount(gaps.run, minlength=context.trace.runs) / context.seconds
    return worst_pair(context, counts)


@label(
    "poor",
    rank=6,
    thresholds=(_MODE_SWITCHES, _MIN_EVENTS),
    letter="C",
    colour="#b4531d",
    advice="more damping, a second number of solref near 1, or a shorter timestep",
    traits=("numerical",),
)
def chatter(runs: MeasuredRuns) -> OnsetIterator:
    """A pair keeps switching between stick and slide, or losing contact; or a servo keeps hunting.

    Not while bodies come to rest, nor outside of the hold window of a scene that has one. If a run
    is the motion of its model, switches under a changing drive do not count, and dry friction may
    stick and slide; except for bodies that a scene declares as held.
    """
    context = runs.context
    has_hold, resolved = context.setup.hold is not None, resolved_runs(context)
    own = np.zeros(context.trace.runs, np.bool_) if resolved is None else resolved
    driven = own & context.setup.steered
    masks = hold_switch_masks(context) if has_hold else switch_masks(context)
    masks = masks & ~(driven if has_hold else own)[:, None]
    between = "stick, slide and no contact in its hold" if has_hold else "stick and slide"
    # Slip between two switches of a chattering pair that hops, in half extents; trembling has
    # 0.003.
    min_hop_slip = 0.02
    for row in runs_where(np.asarray(masks.any(axis=(1, 2)))):
        place = context.pairs.places[row]
        extent = context.setup.thickness[place]
        # A tumbling body alternately sticks and slides as it touches with one point after another.
        tumbles = context.net.rolling[row] * extent > context.net.series.slip[row]
        run, step = np.nonzero(masks[row] & ~tumbles[:, 1:])
        event = f"{context.pairs.names[place]} switched {{}} times between {between}"
        least = 0.0 if has_hold or np.isinf(extent) else min_hop_slip * extent
        yield from _find_frequent(runs, row, (run, step + 1), event, least)
    for row, gaps in () if has_hold else _all_lost_contacts(context).items():
        event = f"{context.pairs.names[context.pairs.places[row]]} lost its contact {{}} times"
        event = f"{event} while it stuck"
        own_gaps = ~driven[gaps.run]
        yield from _find_frequent(runs, row, (gaps.run[own_gaps], gaps.start[own_gaps]), event)
    # Actuators that go from one end of their force to the other under constant controls.
    context, limit = runs.context, runs.limits[_MIN_EVENTS.name]
    trace, mechanism = context.trace, context.setup.mechanism
    if not (
        trace.forces is None or not trace.forces.size or mechanism is None or context.setup.steered
    ):
        (low, high), half = mechanism.forces.T, slice(trace.steps // 2, None)
        share = (trace.forces[:, half] - low) / (high - low)
        # Distance to the end of a force range that counts as its end, as a share of the range.
        force_end_share = 0.01
        ends = np.where(share > 1 - force_end_share, 1, 0) - (share < force_end_share)
        ranges = trace.control_ranges
        still = True if ranges is None else np.ptp(ranges, axis=2) == 0
        for run, place in np.argwhere(still & (ends != 0).any(axis=1)).tolist():
            turns = np.count_nonzero(np.diff(ends[run, ends[run, :, place] != 0, place]))
            if turns >= limit:
                reason = f"{mechanism.actuators[place].name} went {turns} times from one end of its"
                reason = f"{reason} force to the other under constant controls (limit {limit:g})"
                yield run, Onset(reason, half.start, mechanism.actuators[place].bodies)


@cached
def hold_switch_masks(context: Context) -> NDArray[np.bool_]:
    """Return (R, n, N - 1) the steps with a mode change of pairs within the hold window.

    Contact that a sticking pair loses or regains counts too; sliding pairs hop.
    """
    bears, sticks = bearing(context), context.net.series.mode == STICK
    parts = (bears & sticks)[..., :-1] & ~bears[..., 1:]
    meets = ~bears[..., :-1] & (bears & sticks)[..., 1:]
    return (switch_masks(context) | parts | meets) & hold_window(context)[:, 1:]


def lost_contacts(context: Context, row: int) -> Spans:
    """Return the gaps between contacts of a row of pairs that stick before, in and after them.

    A gap counts if it is at most as long as the contact before it; if on both of its sides every
    contact uses less than 0.9 of its bound on force, torsion and rolling together; and if the pair
    then meets as fast as after a fall of 5 ms, and at least as hard as before, by peak force to
    within 1 %.
    """
    bears, series = bearing(context)[row], context.net.series
    touch, gap = find_spans(bears), find_spans(~bears)
    inner = (gap.start > 0) & (gap.stop < bears.shape[1])
    gaps = Spans(gap.run[inner], gap.start[inner], gap.stop[inner])
    if not inner.any():
        return gaps
    # The contacts that end where the gaps start; the next ones follow.
    width = int(max(touch.stop.max(initial=0), gaps.stop.max(initial=0))) + 1
    before = np.searchsorted(touch.run * width + touch.stop, gaps.run * width + gaps.start)
    is_lost = gaps.stop - gaps.start <= touch.stop[before] - touch.start[before]
    is_lost &= series.mode[row, gaps.run, gaps.start] == STICK
    # Two forces, torsion and two rolling torques.
    friction_fields = slice(FORCE.start + 1, TORQUE.stop)
    for step in (gaps.start - 1, gaps.stop):
        # The pair sticks, and each of its contacts is well inside its whole cone.
        of_run = gaps.run[is_lost]
        start = step[is_lost]
        pair = context.trace.pairs[context.pairs.places[row]]
        slots = pair.slots[of_run, start]
        acting = np.abs(slots[..., friction_fields])
        bound = slots[..., FORCE.start, None] * pair.friction[of_run][:, None]
        share = np.divide(acting, bound, out=np.zeros_like(acting), where=acting > 0)
        elliptic = context.setup.elliptic[of_run][:, None]
        bound_share = np.where(elliptic, np.sqrt((share * share).sum(axis=2)), share.sum(axis=2))
        sticks = context.net.series.mode[row, of_run, start] == STICK
        is_lost[is_lost] &= sticks & (bound_share < HELD_USAGE).all(axis=1)
    pair = context.trace.pairs[context.pairs.places[row]]
    meeting = pair.slots[gaps.run[is_lost], gaps.stop[is_lost]]
    speed = np.abs(meeting[..., LINEAR_VELOCITY.start]).max(axis=1, initial=0)
    is_lost[is_lost] &= speed >= IMPACT * context.setup.pull[gaps.run[is_lost]]
    forces, ends = series.normal[row], (before[is_lost], before[is_lost] + 1)
    peaks = [_peak_forces(forces, touch, places) for places in ends]
    min_peak_ratio = 0.99  # smallest ratio of the next to the last peak force; bounces lose more
    is_lost[is_lost] = peaks[1] >= min_peak_ratio * peaks[0]
    return Spans(gaps.run[is_lost], gaps.start[is_lost], gaps.stop[is_lost])


@cached
def _all_lost_contacts(context: Context) -> dict[int, Spans]:
    """Return the gaps of lost contact of sticking pairs, by row of pairs."""
    bears = bearing(context)
    parts = (bears[..., :-1] > bears[..., 1:]).any(axis=(1, 2))
    return {row: lost_contacts(context, row) for row in runs_where(np.asarray(parts))}


def _peak_forces(forces: Floats, touch: Spans, places: NDArray[np.intp]) -> Floats:
    stretches = zip(touch.run[places], touch.start[places], touch.stop[places], strict=True)
    return np.array([forces[run, start:stop].max() for run, start, stop in stretches])


def _find_frequent(
    runs: MeasuredRuns,
    row: int,
    events: Events,
    event: str,
    least: float = 0.0,
) -> OnsetIterator:
    """Find runs with too many events a second that do not end as the run settles.

    A hopping pair must slip by at least `least` [m] between events, in the median.
    """
    limit, fewest = runs.limits[_MODE_SWITCHES.name], runs.limits[_MIN_EVENTS.name]
    series, has_hold = runs.context.net.series, runs.context.setup.hold is not None
    seconds = hold_seconds(runs.context) if has_hold else runs.context.seconds
    counts = np.bincount(events[0], minlength=runs.context.trace.runs)
    min_contact_share = 0.9  # a pair hops if its share of the time in contact is smaller
    # Smallest share of the time in contact that the middle half of the events of chatter spans.
    min_event_spread = 0.25
    for run in runs_where((counts / seconds > limit) & (counts >= fewest)):
        steps = events[1][events[0] == run]
        slips = np.add.reduceat(series.slip[row, run], steps) * runs.context.trace.timestep[run]
        touching = series.mode[row, run] != NO_CONTACT
        hops = bearing(runs.context)[row, run].sum() < min_contact_share * touching.sum()
        if hops and np.median(slips) < least:
            continue
        if has_hold:
            touching &= hold_window(runs.context)[run]
        # Pairs in brief contact may rattle; parts that tumble to rest switch often for a while.
        moment = min(fewest / limit / runs.context.trace.timestep[run], len(touching) / 2)
        early, late = np.quantile(steps, (0.25, 0.75))
        if late - early >= min_event_spread * touching.sum() and (
            has_hold or touching.sum() >= moment
        ):
            rate = counts[run] / seconds[run]
            reason = f"{event.format(counts[run])}, {rate:.3g} times a second (limit {limit:g})"
            place = runs.context.pairs.places[row]
            yield run, Onset(reason, int(steps[0]), bodies_of_pair(runs.context, place))
