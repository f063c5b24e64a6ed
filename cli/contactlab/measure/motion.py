"""Motion of bodies: quantities that must not grow alone, and places that must not change."""

from collections.abc import Sequence
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import DISTANCE, FORCE, Floats, squared_lengths, sum_of_slots
from contactlab.contact.trace_setup import FreeBody
from contactlab.measure.amounts import readable_fraction
from contactlab.measure.backward_error import TOLERANCE, energy_drifts, largest_energy_change
from contactlab.measure.context import (
    NEGLIGIBLE_SHARE,
    Context,
    cached,
    down,
    energy,
    energy_budget,
    first_step,
    free_mass,
    gravity,
    kinetic,
    least_energy,
    peak_kinetic,
    potential,
    runs_where,
    semi_implicit,
    squared_speeds,
    squares_from,
    worst_body,
)
from contactlab.measure.entries import MeasuredRuns, Onset, OnsetIterator, Threshold, label, metric
from contactlab.rendering.amounts import format_amount, format_percent

_DRIFT = Threshold("drift", None, "m", "Set it if bodies should stay.")
_REST_SPEED = Threshold("rest_speed", None, "m/s", "Set it if bodies should come to rest.")


@cached
def energy_scale(context: Context) -> Floats:
    """Return (n,) the reference energy [J] for energy gains."""
    return np.maximum(energy_budget(context), least_energy(context))


@metric("1", "lower", 1e-9, version=3, requires="energy", equivalence=True, heading="gain")
def energy_gain(context: Context) -> Floats:
    """Largest mechanical energy over that at the start, less 1, while nothing drives the scene.

    The datum is the lowest potential energy of the run. The energy at the start counts as at least
    the energy to lift everything by 1 % of a mean body, with the energy stored by a slightly deep
    start, or one outside of limits. The oscillation that semi-implicit steps give springs does not
    count.
    """
    values, driven = _undriven_energy(context), not context.setup.passive
    if driven and not np.isfinite(values[:, 1:]).any():
        return context.undefined()
    initial = values[:, 0] + _stored_at_start(context)
    return (values.max(axis=1) - initial) / energy_scale(context)


@metric("1/s", resolution=1e-12, tolerance=1e-3, requires="energy", equivalence=True)
def energy_drift(context: Context) -> Floats:
    """Change of mechanical energy over the run, over peak kinetic energy and time.

    For passive scenes. Free motion should stay within 0.1 %/s; contact dissipates.
    """
    if not context.setup.passive:
        return context.undefined()
    values = energy(context)
    scale = np.maximum(peak_kinetic(context), least_energy(context))
    return (values[:, -1] - values[:, 0]) / (scale * context.seconds)


@metric("1", "lower", 1e-6, requires="energy")
def speed_ratio(context: Context) -> Floats:
    """Largest speed of a free body over the speed that all the energy of the start would give it.

    For passive scenes; the bound is sqrt(v0^2 + 2 g H) for one body that falls by H. Above 1, a
    body was ejected.
    """
    if not context.setup.passive:
        return context.undefined()

    fastest = np.sqrt(squared_speeds(context).max(axis=-1))
    bodies = zip(fastest, context.setup.free_bodies, strict=True)
    return worst_body(context, [own / _speed_bound(context, body) for own, body in bodies])


@metric("1", "lower", 1e-12, requires="energy")
def momentum_drift(context: Context) -> Floats:
    """Largest change of linear momentum in a free system, over sqrt(2 m K).

    m is the total mass and K the peak kinetic energy. Contact forces are equal and opposite.
    """
    if context.trace.momentum is None:
        return context.undefined()
    return _largest_change(context.trace.momentum) / _momentum_scale(context)


@metric("1", "lower", 1e-12, requires="energy")
def spin_drift(context: Context) -> Floats:
    """Largest change of angular momentum about the center of mass in a free system.

    As a share of its largest magnitude, which counts as at least 1 % of a body times sqrt(2 m K).
    """
    momentum = context.trace.angular_momentum
    if momentum is None:
        return context.undefined()
    largest = np.sqrt(squared_lengths(momentum).max(axis=1))
    arm = NEGLIGIBLE_SHARE * context.setup.size
    return _largest_change(momentum) / np.maximum(largest, arm * _momentum_scale(context))


@metric("s", "lower", requires="energy")
def settle_time(context: Context) -> Floats:
    """Time after which kinetic energy stays below 1e-6 of its peak, if it does so until the end."""
    settled_share = 1e-6  # a run has settled below this share of the peak kinetic energy
    limit = settled_share * np.maximum(peak_kinetic(context), least_energy(context))
    moving = kinetic(context) > limit[:, None]
    settled = context.trace.steps - moving[:, ::-1].argmax(axis=1)
    steps = np.where(moving.any(axis=1), settled, 0)
    never = moving[:, -1] | ~np.isfinite(limit)
    return np.where(never, np.nan, steps * context.trace.timestep)


@metric("m/s", resolution=1e-9)
def final_speed(context: Context) -> Floats:
    """Speed of the fastest free body in the last state."""
    return worst_body(context, np.sqrt(squared_speeds(context)[..., -1]))


@metric("m", "lower", 1e-12)
def drift(context: Context) -> Floats:
    """Distance across gravity between a free body's first and last position, largest of all.

    For bodies at rest it is creep, which grows with time and vanishes with impratio.
    """
    below, bodies = down(context), context.setup.free_bodies
    squares = [_squared_across(context.displacement(body), below) for body in bodies]
    return np.sqrt(worst_body(context, squares))


@metric("m", "lower", 1e-12)
def drop(context: Context) -> Floats:
    """Most that a free body sinks along gravity over the run; negative if all rise."""
    below, bodies = down(context), context.setup.free_bodies
    sunk = [(context.displacement(body) * below).sum(axis=1) for body in bodies]
    return worst_body(context, sunk)


@metric("m/s", "lower", 1e-12)
def rest_speed(context: Context) -> Floats:
    """Largest speed of a free body in the last fifth of the run; bodies at rest still creep."""
    last = slice(context.last_fifth.start + 1, None)
    return np.sqrt(worst_body(context, squared_speeds(context)[..., last].max(axis=-1)))


@metric("any", resolution=1e-9)
def joint_travel(context: Context) -> Floats:
    """Path length, back and forth, of the joint coordinate that moves most [m or rad].

    Free bodies do not count.
    """
    free = {body.dof + place for body in context.setup.free_bodies for place in range(6)}
    jointed = [place for place in range(context.trace.qvel.shape[2]) if place not in free]
    if not jointed:
        return context.undefined()
    rates = np.abs(context.trace.qvel[:, 1:][:, :, jointed])
    return rates.sum(axis=1).max(axis=1) * context.trace.timestep


@metric("any", resolution=1e-9)
def actuator_effort(context: Context) -> Floats:
    """Root mean square over time of the forces of all actuators together, each in N or N m."""
    forces = context.trace.forces
    if forces is None or not forces.shape[2]:
        return context.undefined()
    return np.sqrt((forces * forces).sum(axis=2).mean(axis=1))


@metric("rad", resolution=1e-9)
def turn(context: Context) -> Floats:
    """Angular speed summed over time of the free body that turns most."""
    starts = [body.dof + 3 for body in context.setup.free_bodies]
    angles = np.sqrt(squares_from(context.trace.qvel, starts))[..., 1:].sum(axis=-1)
    return worst_body(context, angles) * context.trace.timestep


@cached
def list_final_falls(context: Context) -> dict[int, str]:
    """Return the free body that falls farthest at the end after it lost its contacts, by run.

    It is farther below all places where it touched anything than it reaches, and has gained at
    least half the speed of a free fall since its last contact.
    """
    trace, below, setup = context.trace, down(context), context.setup
    parts = setup.mechanism.joints if setup.mechanism else ()
    reaches = {part.place: part.reach for part in parts}
    least_share = 0.5  # of a free fall: air and turns about another point than the frame slow it
    farthest: dict[int, tuple[float, str]] = {}
    for body in setup.free_bodies:
        own = np.array([body.name in sides for sides in setup.sides], np.bool_)
        rows = context.pairs.rows[own] if own.any() else ()
        if not len(rows) or not trace.steps:
            continue
        touches = np.logical_or.reduce(context.net.found[rows] > 0)
        depth = np.einsum("nti,ni->nt", context.position(body), below)
        lowest = depth[:, :-1].max(axis=1, where=touches, initial=-np.inf)
        fallen = depth[:, -1] - lowest
        leaves = trace.steps - touches[:, ::-1].argmax(axis=1)  # the state after the last contact
        runs = np.arange(trace.runs)
        speed = np.einsum("nti,ni->nt", context.velocity(body), below)
        gained = speed[:, -1] - speed[runs, leaves]
        free = least_share * gravity(context) * (trace.steps - leaves) * trace.timestep
        far = fallen > reaches.get(body.qpos, setup.size)
        for run in runs_where(touches.any(axis=1) & far & (gained >= free)):
            note = f"{body.name} falls at the end, {format_amount(fallen[run], 'mm')} below all"
            note = f"{note} of its contacts"
            farthest[run] = max(farthest.get(run, (0.0, "")), (float(fallen[run]), note))
    return {run: note for run, (_, note) in farthest.items()}


@label(
    "bad",
    rank=1,
    thresholds=(
        Threshold(
            "energy_gain",
            0.01,
            "1",
            "A passive scene gains no energy; a rise by a tenth of the tolerance is not rounding.",
        ),
        TOLERANCE,
    ),
    judged_on=(("energy_gain", "energy_gain"), ("backward_error_energy", TOLERANCE.name)),
    letter="E",
    colour="#d71ec9",
    advice="a timestep of at most 0.8 times timeconst times dampratio of solref",
    traits=("numerical",),
)
def energy_injection(runs: MeasuredRuns) -> OnsetIterator:
    """A passive scene gained energy or ejected a body, or a run gains but its model does not.

    A passive scene must not gain energy: an invariant. For any run, the gain is its drift of
    energy.
    """
    context = runs.context
    for run, gain, limit in runs.over("energy_gain"):
        values = _undriven_energy(context)[run]
        initial = values[0] + _stored_at_start(context)[run]
        risen = values - initial > limit * energy_scale(context)[run]
        where, _ = largest_energy_change(context, run)
        reason = (
            f"energy rose by {readable_fraction(gain)} that at the start{where} "
            f"(limit {format_percent(limit)})"
        )
        yield run, Onset(reason, first_step(risen))
    limit = np.sqrt(1 + runs.limits[TOLERANCE.name])  # Energy goes with the square of speed.
    for run in runs_where(runs.metrics["speed_ratio"] > limit):
        ratio = float(runs.metrics["speed_ratio"][run])
        bounds = [_speed_bound(context, body) for body in context.setup.free_bodies]
        fast = [
            squares[run] > (limit * most[run]) ** 2
            for squares, most in zip(squared_speeds(context), bounds, strict=True)
        ]
        names = _names_where(context, fast)
        share = readable_fraction(ratio)
        reason = f"{_first_name(names)} moved {share} as fast as the energy at the start allows"
        yield run, Onset(f"{reason} (limit {limit:.3g})", max(_first_step_of(fast) - 1, 0), names)
    yield from energy_drifts(runs, 1)


@label(
    "bad",
    rank=3,
    thresholds=(TOLERANCE,),
    letter="A",
    colour="#8e3a6e",
    advice="sleep off, or a lower sleep_tolerance",
)
def asleep_unsupported(runs: MeasuredRuns) -> OnsetIterator:
    """A body was put to sleep although nothing holds it, in mid-air or in mid-motion.

    Awake it would have moved on by more than 1 % of a mean body, and by more than the tolerance of
    its path.
    """
    setup, sleeper = runs.context.setup, runs.context.trace.sleeper
    if setup.mechanism is None or sleeper is None:
        return
    limit, hair = runs.limits[TOLERANCE.name], NEGLIGIBLE_SHARE * setup.size
    for run in runs_where((sleeper[:, 1] > limit) & (sleeper[:, 0] > hair)):
        distance, share, place, step = sleeper[run]
        joint = setup.mechanism.joints[int(place)]
        way = format_amount(distance, "mm")
        motion = f"{joint.name} sleeps, but awake would have moved on by {way}"
        reason = f"{motion}, {format_percent(share)} of its path (limit {format_percent(limit)})"
        yield run, Onset(reason, int(step), joint.bodies)


@label(
    "poor",
    rank=7,
    name="drift",
    thresholds=(_DRIFT,),
    letter="W",
    colour="#7b449c",
    advice="impratio 10 and an elliptic cone, or a shorter time constant of solref",
)
def drifting(runs: MeasuredRuns) -> OnsetIterator:
    """A body that should stay ended farther from its start than the scene accepts."""
    places = [runs.context.position(body) for body in runs.context.setup.free_bodies]
    for run, moved, limit in runs.over("drift"):
        below, paths = down(runs.context)[run], [place[run] - place[run, 0] for place in places]
        away = [np.sqrt(_squared_across(path, below)) > limit for path in paths]
        names = _names_where(runs.context, [path[-1:] for path in away])
        way, most = format_amount(moved, "mm"), format_amount(limit, "mm")
        reason = f"{_first_name(names)} ended {way} away from its start (limit {most})"
        yield run, Onset(reason, _first_step_of(away) - 1, names)


@label(
    "poor",
    rank=2,
    thresholds=(_REST_SPEED,),
    letter="U",
    colour="#9edaff",
    advice="a longer run, or more damping",
)
def unsettled(runs: MeasuredRuns) -> OnsetIterator:
    """A body still moves in the last fifth of the run, although the scene requires rest."""
    squares, start = squared_speeds(runs.context), runs.context.last_fifth.start
    for run, speed, limit in runs.over("rest_speed"):
        fast = squares[:, run, start + 1 :] > limit**2
        names = _names_where(runs.context, [*fast])
        pace, most = format_amount(speed, "mm/s"), format_amount(limit, "mm/s")
        reason = f"{_first_name(names)} moved at {pace} in the last fifth (limit {most})"
        yield run, Onset(reason, start + _first_step_of([*fast]), names)


@cached
def _level_energy(context: Context) -> Floats:
    """Return (n, N) mechanical energy [J] without the oscillation that a step gives it at a spring.

    Semi-implicit velocities lag behind positions by half a step. In a mean over two states, later
    kinetic and earlier potential energy count three times, so that the second-order oscillation
    cancels.
    """
    values = energy(context)
    if not context.setup.springs or context.trace.steps < 2:
        return values
    moving, stored = kinetic(context), potential(context)
    level = moving[:, :-1] + 3 * moving[:, 1:] + 3 * stored[:, :-1] + stored[:, 1:]
    level = np.concatenate([level, level[:, -1:]], axis=1) / 4
    return np.where(semi_implicit(context)[:, None] > 0, level, values)


@cached
def _undriven_energy(context: Context) -> Floats:
    """Return (n, N) level energies [J]; -inf after the first input."""
    values = _level_energy(context)
    if context.setup.passive:
        return values
    steps = context.setup.undriven / context.trace.timestep - 1
    return np.where(np.arange(values.shape[1]) < steps[:, None], values, -np.inf)


@cached
def _stored_at_start(context: Context) -> Floats:
    """Return (n,) the energy [J] that constraints have stored at the start.

    Contacts store at most depth, from the farthest distance ever seen in their margin, times force
    at the start or the end; and at most the energy to lift everything by a tenth of the thinner
    half extent.
    """
    # Allowed depth of a start, as a share of the thinner body's half extent.
    start_depth_share = 0.1
    most, gain = (
        start_depth_share * context.setup.moving_mass * gravity(context),
        context.trace.constraint_gain,
    )
    stored = np.zeros(context.trace.runs) if gain is None else np.nan_to_num(gain[:, 3])
    # Pairs without contact at the start store nothing, unless their force at the end is NaN.
    ends = context.net.found[..., 0].any(axis=1), context.net.series.normal[..., -1]
    for row in runs_where(np.asarray(ends[0] | ~np.isfinite(ends[1]).all(axis=1))):
        place = context.pairs.places[row]
        pair, thickness = context.trace.pairs[place], context.setup.thickness[place]
        first, last = pair.slots[:, 0], pair.slots[:, -1]
        forces = (sum_of_slots(contact[..., FORCE.start], axis=1) for contact in (first, last))
        depth = (context.net.farthest[row][:, None] - first[..., DISTANCE]).max(
            axis=1, where=first.any(axis=2), initial=0
        )
        stored += np.fmin(np.maximum(*forces) * depth, most * thickness)
    return stored


def _names_where(context: Context, masks: Sequence[NDArray[np.bool_]]) -> tuple[str, ...]:
    """Return the names of free bodies with any true step in their mask, earliest first."""
    bodies = zip(context.setup.free_bodies, masks, strict=True)
    marked = [(first_step(mask), body.name) for body, mask in bodies if mask.any()]
    return tuple(name for _, name in sorted(marked, key=itemgetter(0)))


def _first_name(names: Sequence[str]) -> str:
    return names[0] if names else "a body"


def _first_step_of(masks: list[NDArray[np.bool_]]) -> int:
    """Return the first true step of any of some masks; 0 if none is true."""
    return first_step(np.logical_or.reduce(masks))


def _speed_bound(context: Context, body: FreeBody) -> Floats:
    """Return (n,) the highest speed [m/s] of a body's frame with all of the energy budget."""
    energies = np.maximum(energy_budget(context) + _stored_at_start(context), least_energy(context))
    return np.sqrt(2 * energies / (body.share * body.mass))


def _momentum_scale(context: Context) -> Floats:
    # The peak kinetic energy allows no larger momentum [kg m/s].
    return np.sqrt(
        2 * free_mass(context) * np.maximum(peak_kinetic(context), least_energy(context))
    )


def _largest_change(vectors: Floats) -> Floats:
    return np.sqrt(squared_lengths(vectors - vectors[:, :1]).max(axis=1))


def _squared_across(vectors: Floats, below: Floats) -> Floats:
    """Return the squared length of vectors (..., 3) across a unit vector or zero (..., 3)."""
    across = vectors - (vectors * below).sum(axis=-1, keepdims=True) * below
    return (across * across).sum(axis=-1)
