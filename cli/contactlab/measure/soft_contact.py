"""Soft contact: the metric of restitution, and closed forms of impacts and of rest."""

import numpy as np

from contactlab.contact.contact_laws import (
    damping_ratio,
    restitution_from_damping,
    stiffness_damping,
)
from contactlab.contact.contact_laws import rest_penetration as resting_depth
from contactlab.contact.trace_arrays import (
    DISTANCE,
    FORCE,
    FOUND,
    NORMAL,
    POSITION,
    Floats,
    PairTrace,
    sum_of_slots,
)
from contactlab.contact.trace_setup import Barrier
from contactlab.measure.context import Context, cached, contact_depths, friction, gravity
from contactlab.measure.entries import metric, oracle
from contactlab.measure.penetration import steady_depths
from contactlab.measure.stick_slip import IMPACT, Rows, Spans, find_spans
from contactlab.mjcf import AT_REST

_CORNER_CONTACTS = 4  # contacts of two boxes, or a box and the floor, face to face


@metric("1", resolution=1e-6, version=2)
@cached
def restitution_measured(context: Context) -> Floats:
    """Normal speed after an impact over that before, of a free body on a fixed surface.

    In the free flight next to the contact. Mean over those of the first five impacts that are
    central, as fast as after a fall of 5 ms, and at least 0.3 times as fast as the first.
    """
    runs = context.trace.runs
    total, count = np.zeros(runs), np.zeros(runs)
    for barrier in context.setup.barriers:
        run, ratio = _find_bounces(context, barrier)
        total += np.bincount(run, weights=ratio, minlength=runs)
        count += np.bincount(run, minlength=runs)
    return np.where(count > 0, total / np.where(count > 0, count, 1), np.nan)


def _find_bounces(context: Context, barrier: Barrier) -> tuple[Rows, Floats]:
    """Return run and restitution of the impacts that count, in order of run and time."""
    # Each run's first contacts with a flight before and after, and their number.
    touch_spans = find_spans(context.net.series.contacts[context.pairs.rows[barrier.pair]] > 0)
    whole = (touch_spans.start > 0) & (touch_spans.stop < context.trace.steps)
    run = touch_spans.run[whole]
    rank = np.arange(len(run)) - np.searchsorted(run, run)
    max_impacts = 5
    few = rank < max_impacts
    starts, stops = touch_spans.start[whole][few], touch_spans.stop[whole][few]
    touches, rank = Spans(run[few], starts, stops), rank[few]
    if not rank.size:
        return rank, np.empty(0)
    approach, rebound = _touch_speeds(context, barrier, touches)
    first = np.zeros(context.trace.runs)
    first[touches.run[rank == 0]] = np.nan_to_num(approach[rank == 0])
    min_speed_ratio = 0.3
    counts = (approach >= IMPACT * context.setup.pull[touches.run]) & (
        approach >= min_speed_ratio * first[touches.run]
    )
    # The line of the first force of each contact passes near the body's origin.
    slots = context.trace.pairs[barrier.pair].slots[touches.run, touches.start]
    start = barrier.body.qpos
    arms = (
        slots[..., POSITION]
        - context.trace.qpos[touches.run, touches.start][:, None, start : start + 3]
    )
    weights = slots[..., FORCE.start, None] + np.finfo(float).tiny * (slots[..., FOUND, None] > 0)
    arm = sum_of_slots(arms * weights, axis=1)
    across = arm - (arm @ barrier.normal)[:, None] * barrier.normal
    max_off_center = 0.1  # largest share of a lever arm across the surface in a central impact
    counts &= np.isfinite(rebound) & (
        np.linalg.norm(across, axis=1) <= max_off_center * np.linalg.norm(arm, axis=1)
    )
    return touches.run[counts], rebound[counts] / approach[counts]


def _touch_speeds(context: Context, barrier: Barrier, touches: Spans) -> tuple[Floats, Floats]:
    """Return the speeds [m/s] at touch before and after each contact, NaN if it is not a bounce.

    Extrapolated from free flight to the height of touch: ``v^2 + 2 g s`` is constant, with s the
    gap. For a speculative contact that height is unknown, and the speed is that of the sample.
    """
    speculative = context.setup.speculative
    is_speculative = 1.0 if speculative is None else ~speculative[touches.run]
    side = np.sign(_height_above(context, barrier, np.arange(context.trace.runs), 0))[touches.run]
    normal = side[:, None] * barrier.normal
    distance = context.net.series.distance[context.pairs.rows[barrier.pair]]
    fall = -(context.setup.gravity[touches.run] * normal).sum(axis=1)

    def speed(free: Rows, touching: Rows, direction: int) -> Floats:
        where = touches.run, free
        dof = barrier.body.dof
        away = (context.trace.qvel[*where, dof : dof + 3] * normal).sum(axis=1)
        depth = distance[touches.run, touching]
        at_touch = side * _height_above(context, barrier, touches.run, touching) - depth
        gap = side * _height_above(context, barrier, *where) - at_touch
        square = np.maximum(away**2 + 2 * fall * gap * is_speculative, 0)
        return np.where(away * direction > 0, np.sqrt(square), np.nan)

    before = speed(touches.start - 1, touches.start, -1)
    return before, speed(touches.stop, touches.stop - 1, 1)


def _height_above(context: Context, barrier: Barrier, run: Rows, step: Rows | int) -> Floats:
    """Return signed heights [m] of the body's origin above the barrier's mid-plane."""
    start = barrier.body.qpos
    return (context.trace.qpos[run, step, start : start + 3] - barrier.point) @ barrier.normal


@metric("1", "lower", 1e-9, requires="depth")
def at_rest_error(context: Context) -> Floats:
    """Relative error of the requested `stiffness` or `depth_at_rest` of resting pairs.

    In the last fifth of the run: load over depth of all contacts of a pair, or their mean depth,
    from where force begins; worst of the pairs that touch in 90 % of it.
    """
    errors, tail = [context.undefined()], context.last_fifth
    setting_names = [name for name in AT_REST if name in context.setup.settings]
    resting_share = 0.9  # a pair at rest touches in this share of the last fifth
    for pair in context.trace.pairs if setting_names else ():
        begin = context.setting("margin")[:, None, None]
        slots = pair.slots[:, tail]
        rests = (slots[..., FOUND] > 0).any(axis=2).mean(axis=1) >= resting_share
        depth = _mean_of_contacts(pair, tail, begin - slots[..., DISTANCE])
        observed = {
            "stiffness": _mean_of_contacts(pair, tail, slots[..., FORCE.start]) / depth,
            "depth_at_rest": depth,
        }
        sizes = (np.abs(observed[name] / context.setting(name) - 1) for name in setting_names)
        errors += [np.where(rests, size, np.nan) for size in sizes]
    return np.fmax.reduce(errors)


def restitution_of_solref(context: Context) -> Floats:
    """Return (n,) the restitution that follows from the damping ratio of solref."""
    return restitution_from_damping(damping_ratio(context.setting("solref")))


@oracle("1", ("solref",), relative=False)
def restitution(context: Context) -> tuple[Floats, Floats]:
    """Restitution e = exp(-2 zeta acos(zeta) / sqrt(1 - zeta^2)), zeta the damping ratio of solref.

    The oscillator of MuJoCo's contact with constant impedance and a force that only pushes; for
    impacts fast compared with g / w and w timestep <= 0.1, w its rate. Measured:
    restitution_measured.
    """
    return restitution_of_solref(context), restitution_measured(context)


@oracle("1", ("solref",), relative=False)
def pair_restitution(context: Context) -> tuple[Floats, Floats]:
    """Restitution of two free bodies, e = exp(-2 zeta acos(zeta) / sqrt(1 - zeta^2)).

    zeta is the damping ratio of solref, a rate, for bodies of any mass. Measured: relative velocity
    of the first two free bodies in the last state over that in the first, along the centers.
    """
    one, other = (context.velocity(body) for body in context.setup.free_bodies[:2])
    approach, parting = (one[:, state] - other[:, state] for state in (0, -1))
    square = (approach**2).sum(axis=1)
    return restitution_of_solref(context), -(approach * parting).sum(axis=1) / square


@oracle("1", ("solref", "speed"), relative=False)
def impact_depth(context: Context) -> tuple[Floats, Floats]:
    """Depth of an impact, (v / w) exp(-zeta acos(zeta) / sqrt(1 - zeta^2)).

    The turning point of an oscillator of rate w and damping ratio zeta hit at speed v, fast
    compared with g / w: 0.368 v tc at critical damping. Not defined for speculative contacts.
    Measured: the largest penetration of any pair. Both are over the distance that the body moves in
    a step.
    """
    solref, speed = context.setting("solref"), context.setting("speed")
    rate = np.sqrt(stiffness_damping(solref)[0])
    depth = speed / rate * np.sqrt(restitution_from_damping(damping_ratio(solref)))
    if context.setup.speculative is not None:
        depth = np.where(context.setup.speculative, np.nan, depth)
    deepest = np.fmax.reduce(contact_depths(context)[1].max(axis=-1))
    travel = speed * context.trace.timestep
    return depth / travel, deepest / travel


@oracle("m/s", ("solref", "solimp", "overlap"), relative=True)
def separation_speed(context: Context) -> tuple[Floats, Floats]:
    """Speed v = w r exp(-zeta acos(zeta) / sqrt(1 - zeta^2)) at which overlapping bodies separate.

    The contact's oscillator, of rate w and damping ratio zeta, from overlap r at rest; K and B of N
    equal contacts are N / (1 + (N - 1) d) times those of one, for constant impedance d without
    friction or gravity. Measured: relative speed of the first two free bodies in the last state.
    """
    solref = context.setting("solref")
    stiffness, _ = stiffness_damping(solref)
    # Each of N contacts is regularized separately: together they reach d N / (1 + (N - 1) d).
    contacts, impedance = context.trace.pairs[0].found[:, 0], context.setting("solimp")[:, 1]
    shared = contacts / (1 + (contacts - 1) * impedance)
    restitution_root = np.sqrt(restitution_from_damping(damping_ratio(solref) * np.sqrt(shared)))
    speed = np.sqrt(stiffness * shared) * context.setting("overlap") * restitution_root
    one, other = (context.velocity(body)[:, -1] for body in context.setup.free_bodies[:2])
    return speed, np.linalg.norm(other - one, axis=1)


@oracle("1", ("solref", "friction"), relative=False)
def oblique_impact(context: Context) -> tuple[Floats, Floats]:
    """Velocity of a point mass after an impact with friction (Newton, Coulomb).

    At velocity (v_t, -v_n) it gets J_n = (1 + e) m v_n and J_t = min(mu J_n, m v_t) against v_t,
    with e from the damping ratio of solref. Measured: distance of the last velocity from that law,
    over the speed at the start. The first slides are along x, y and the normal z, without gravity.
    """
    before, after = context.trace.qvel[:, 0, :3], context.trace.qvel[:, -1, :3]
    push = -(1 + restitution_of_solref(context)) * before[:, 2]
    tangential = np.linalg.norm(before[:, :2], axis=1)
    lost = np.minimum(friction(context) * push, tangential)
    kept_share = 1 - lost / np.where(tangential > 0, tangential, 1)
    rebound = np.column_stack([before[:, :2] * kept_share[:, None], before[:, 2] + push])
    error = np.linalg.norm(after - rebound, axis=1)
    return np.zeros(context.trace.runs), error / np.linalg.norm(before, axis=1)


@oracle("1", ("friction", "solref", "cut"), relative=False)
def throw(context: Context) -> tuple[Floats, Floats]:
    """Tangent of the angle by which friction throws a ball off the line of centers.

    mu while two equal solid balls slide on each other, and 2/7 tan(cut) / (1 + e) if friction stops
    that, whichever is less (Coulomb's law for impulses). Measured: velocity of the second free
    body, which was at rest, in the last state; line of centers at first touch.
    """
    bounce_ratio = restitution_of_solref(context)
    # 1 / (1 + 5 / 2): relative sideways inertia of a hit at a ball's surface
    ball_inertia_share = 2 / 7
    stick = ball_inertia_share * np.tan(np.radians(context.setting("cut"))) / (1 + bounce_ratio)
    pair = context.trace.pairs[0]
    first = pair.touching[:, :, 0].argmax(axis=1)
    line = pair.slots[np.arange(len(first)), first, 0, NORMAL]
    thrown = context.velocity(context.setup.free_bodies[1])[:, -1]
    along = np.abs((thrown * line).sum(axis=1))
    across = np.linalg.norm(np.cross(thrown, line), axis=1)
    return np.minimum(friction(context), stick), across / along


@oracle("deg", ("angle",), relative=False)
def swing_transfer(context: Context) -> tuple[Floats, Floats]:
    """Angle to which the last pendulum of a cradle swings: the start angle of the first.

    Equal balls transfer all momentum and energy. Measured: the last hinge's angle at which it first
    comes to rest after it has left by over a degree.
    """
    swing = -context.trace.qpos[:, :, -1]
    out = swing > swing[:, :1] + np.radians(1)
    out[:, -1] = False
    rising = np.diff(swing, axis=1) > 0
    first = out.argmax(axis=1)
    after = np.arange(rising.shape[1]) >= first[:, None]
    peak = (after & ~rising).argmax(axis=1)
    highest = swing[np.arange(len(swing)), peak]
    largest_angle = np.degrees(np.where(out.any(axis=1), highest, np.nan))
    return context.setting("angle"), largest_angle


@oracle("m", ("solref", "solimp"), relative=True)
def rest_penetration(context: Context) -> tuple[Floats, Floats]:
    """Depth r at which g (1 - d(r)) dwidth^2 / (K d(r)^2) = r.

    One contact, with K and d of solref and solimp, carries a body of any mass; frictionless or with
    an elliptic cone. Measured: the penetration of the first pair in the last step.
    """
    mass = context.setup.free_bodies[0].mass
    solref, solimp = context.setting("solref"), context.setting("solimp")
    expected = resting_depth(mass * gravity(context), 1 / mass, solref, solimp)
    return expected, -context.net.series.distance[context.pairs.rows[0], :, -1]


@oracle("m", ("solref", "solimp"), relative=True)
def stack_sag(context: Context) -> tuple[Floats, Floats]:
    """Depth by which the top of a stack of boxes sinks under its weight.

    Sum over the layers, from the floor up, of r with F A (1 - d(r)) dwidth^2 / (K d(r)^2) = r, F a
    quarter of the weight above, A = 1/m1 + 1/m2 (1/m on the floor), K and d from solref and solimp.
    Measured: the sum of the pairs' mean penetrations in the last fifth of the run.
    """
    mass = np.stack([body.mass for body in context.setup.free_bodies], axis=1)
    carried = mass[:, ::-1].cumsum(axis=1)[:, ::-1] * gravity(context)[:, None]
    inverse = 1 / mass
    inverse[:, 1:] += 1 / mass[:, :-1]
    solref, solimp = context.setting("solref"), context.setting("solimp")
    depths = resting_depth(carried / _CORNER_CONTACTS, inverse, solref[:, None], solimp[:, None])
    tail = context.last_fifth
    layers = [
        _mean_of_contacts(pair, tail, np.maximum(-pair.slots[:, tail, :, DISTANCE], 0))
        for pair in context.trace.pairs
    ]
    # Add one by one: for a single run NumPy would add them in another order.
    return depths.sum(axis=1), sum(layers, np.zeros(context.trace.runs))


@oracle("m", ("mass", "solref", "solimp"), relative=True)
def foot_depth(context: Context) -> tuple[Floats, Floats]:
    """Depth r at which F A (1 - d(r)) dwidth^2 / (K d(r)^2) = r, of a foot under its robot.

    F is a quarter of the weight of a foot m and a trunk M = 10 kg, A = (1/m + 2/(m + M))/3 the
    foot's inverse mass, averaged over directions as in the engine, and K, d are from solref, not
    lengthened to two timesteps, and solimp. Measured: the metric penetration_steady.
    """
    foot = context.setting("mass")
    trunk_mass_kg = 10.0
    robot = foot + trunk_mass_kg
    # Along the leg the foot moves alone, across it with the trunk.
    inverse = (1 / foot + 2 / robot) / 3
    solref, solimp = context.setting("solref"), context.setting("solimp")
    expected = resting_depth(robot * gravity(context) / _CORNER_CONTACTS, inverse, solref, solimp)
    return expected, steady_depths(context)[0]


def _mean_of_contacts(pair: PairTrace, tail: slice, values: Floats) -> Floats:
    """Return (n,) values (n, T, S), averaged over a pair's contacts and then over time."""
    total = sum_of_slots(values * (pair.slots[:, tail, :, FOUND] > 0), axis=2)
    touching = np.minimum(pair.slots[:, tail, 0, FOUND], pair.slots.shape[2])
    return (total / np.maximum(touching, 1)).mean(axis=1)
