"""Closed forms of rest and rolling: how deep bodies sink under their weight, and how balls roll."""

import numpy as np

from contactlab.contact.contact_laws import rest_penetration as resting_depth
from contactlab.contact.trace_arrays import DISTANCE, FOUND, Floats, PairTrace
from contactlab.measure.context import Context
from contactlab.measure.entries import oracle
from contactlab.measure.oracle_error import (
    along_direction,
    displacement,
    distance_from_rest,
    friction,
    gravity,
)
from contactlab.measure.penetration import steady_by_pair

_CORNERS = 4
"""Contacts between two boxes, or a box and the floor, that meet face to face."""

_TRUNK = 10.0


@oracle(unit="m", settings=("solref", "solimp"), relative=True)
def rest_penetration(context: Context) -> tuple[Floats, Floats]:
    """Depth r at which g (1 - d(r)) dwidth^2 / (K d(r)^2) = r.

    K and d are from solref and solimp: one contact that carries a body on a fixed floor, whatever
    its mass. Holds for frictionless contacts and elliptic cones. Measured: the penetration of the
    first pair in the last step.
    """
    mass = context.setup.free_bodies[0].mass
    solref, solimp = context.setting("solref"), context.setting("solimp")
    expected = resting_depth(mass * gravity(context), 1 / mass, solref, solimp)
    return expected, -context.series[0].distance[:, -1]


@oracle(unit="m", settings=("solref", "solimp"), relative=True)
def stack_sag(context: Context) -> tuple[Floats, Floats]:
    """Depth by which the top of a stack of boxes sinks under its weight.

    Sum over the layers of the depth r at which F A (1 - d(r)) dwidth^2 / (K d(r)^2) = r, with F a
    quarter of the weight above, A = 1/m1 + 1/m2 (1/m on the floor) and K, d from solref and
    solimp. Free bodies and pairs are listed from the floor up. Measured: the sum over the pairs of
    their mean penetration in the last fifth of the run.
    """
    mass = np.stack([body.mass for body in context.setup.free_bodies], axis=1)
    carried = mass[:, ::-1].cumsum(axis=1)[:, ::-1] * gravity(context)[:, None]
    inverse = 1 / mass
    inverse[:, 1:] += 1 / mass[:, :-1]
    solref, solimp = context.setting("solref"), context.setting("solimp")
    depths = resting_depth(carried / _CORNERS, inverse, solref[:, None], solimp[:, None])
    layers = [_mean_depth(pair, context.last_fifth) for pair in context.trace.pairs]
    return depths.sum(axis=1), np.sum(layers, axis=0)


@oracle(unit="m", settings=("mass", "solref", "solimp"), relative=True)
def foot_depth(context: Context) -> tuple[Floats, Floats]:
    """Depth r at which F A (1 - d(r)) dwidth^2 / (K d(r)^2) = r, of a foot under its robot.

    F is a quarter of the weight of a foot m and a trunk M = 10 kg above it,
    A = (1/m + 2/(m + M))/3 the foot's inverse mass averaged over directions, as the engine takes
    it, and K, d are from the requested solref and solimp: a time constant below two timesteps is
    lengthened by the engine, and missed here. Measured: the metric penetration_steady.
    """
    foot = context.setting("mass")
    robot = foot + _TRUNK
    # Along the leg the foot moves alone, across it with the trunk.
    inverse = (1 / foot + 2 / robot) / 3
    solref, solimp = context.setting("solref"), context.setting("solimp")
    expected = resting_depth(robot * gravity(context) / _CORNERS, inverse, solref, solimp)
    return expected, steady_by_pair(context)[0]


def _mean_depth(pair: PairTrace, tail: slice) -> Floats:
    """Return (n,) depth [m] of a pair, averaged over its contacts and then over time."""
    depth = np.maximum(-pair.slots[:, tail, :, DISTANCE], 0).sum(axis=2)
    touching = np.minimum(pair.slots[:, tail, 0, FOUND], pair.slots.shape[2])
    return (depth / np.maximum(touching, 1)).mean(axis=1)


_LEFT = 0.05
"""Share of the slip at the start that counts as rolling: well above the creep of soft contact."""

_SPHERE = 3.5
"""1 + m r^2 / I of a homogeneous sphere."""


@oracle(unit="1", settings=("tilt", "weight", "direction", "friction", "integrator"), relative=True)
def roll_down(context: Context) -> tuple[Floats, Floats]:
    """Share of its frictionless way that a homogeneous sphere rolls down a slope: 5/7.

    On a slope of the angle `tilt`, if mu >= (2/7) tan(tilt), and else 1 - mu / tan(tilt).
    Measured: displacement of the first free body down the slope over g sin(tilt) t^2 / 2, with
    m g the scene's `weight`.
    """
    tilt = np.radians(context.setting("tilt"))
    slides = 1 - friction(context) / np.tan(tilt)
    weight = context.setting("weight") / context.setup.free_bodies[0].mass
    free = weight * np.sin(tilt) * distance_from_rest(context, context.trace.steps)
    return np.maximum(5 / 7, slides), along_direction(context, displacement(context)) / free


@oracle(unit="s", settings=("friction",), relative=True)
def slide_to_roll(context: Context) -> tuple[Floats, Floats]:
    """Time until a homogeneous sphere that starts to slide at v0 without turning rolls.

    It slips at v0 - (7/2) mu g t. Measured: the time at which |v| - r |w| of the first free body
    is down to 5 % of v0; the last percents are creep.
    """
    speed = _rate(context, 0)
    slip = speed - context.setup.thickness[0] * _rate(context, 3)
    rolls = slip <= _LEFT * speed[:, :1]
    time = rolls.argmax(axis=1) * context.trace.timestep
    stop = 2 * speed[:, 0] / (7 * friction(context) * gravity(context))
    return (1 - _LEFT) * stop, np.where(rolls.any(axis=1), time, np.nan)


@oracle(unit="m/s^2", settings=("friction",), relative=True)
def roll_friction(context: Context) -> tuple[Floats, Floats]:
    """Deceleration mu_r g / (1.4 r) of a homogeneous sphere of radius r that rolls.

    The moment mu_r N turns m r^2 7/5. Measured: mean deceleration of the first free body, which
    must not stop within the run.
    """
    speed, radius = _rate(context, 0), context.setup.thickness[0]
    expected = friction(context, 3) * gravity(context) / (1.4 * radius)
    return expected, (speed[:, 0] - speed[:, -1]) / context.seconds


@oracle(unit="rad/s^2", settings=("friction",), relative=True)
def spin_down(context: Context) -> tuple[Floats, Floats]:
    """Angular deceleration mu_t g / (0.4 r^2) of a homogeneous sphere that spins on the spot.

    The moment mu_t N about the normal turns m r^2 2/5. Measured: mean angular deceleration of the
    first free body, which must not stop within the run.
    """
    rate, radius = _rate(context, 3), context.setup.thickness[0]
    expected = friction(context, 2) * gravity(context) / (0.4 * radius**2)
    return expected, (rate[:, 0] - rate[:, -1]) / context.seconds


@oracle(unit="m^2/s^2", settings=("force", "direction"), relative=False)
def rolling_plate(context: Context) -> tuple[Floats, Floats]:
    """Squared velocity error of a plate pulled over the ground and of balls that roll on it: 0.

    A plate of mass M that is pulled by F and carries n homogeneous balls of mass m slides with
    f1 = mu (M + n m) g; balls that roll on it without slipping take
    f2 = ((F - f1) / M) / (3.5 / m + n / M) each. So the plate accelerates at (F - f1 - n f2) / M
    and a ball at f2 / m. Measured: the squared velocity error of the plate and of a ball, averaged
    over time (and over the balls) and added.
    """
    of_plate, of_ball = _accelerations(context)
    plate = _velocity_error(context, 0, of_plate)
    balls = range(1, len(context.setup.free_bodies))
    ball = np.mean([_velocity_error(context, index, of_ball) for index in balls], axis=0)
    return np.zeros_like(plate), plate + ball


def _rate(context: Context, offset: int) -> Floats:
    """Return (n, N + 1) the first free body's speed [m/s], or at offset 3 angular rate [rad/s]."""
    dof = context.setup.free_bodies[0].dof + offset
    return np.linalg.norm(context.trace.qvel[:, :, dof : dof + 3], axis=2)


def _accelerations(context: Context) -> tuple[Floats, Floats]:
    """Return (n,) the accelerations [m/s^2] of the plate and of a ball along the pull."""
    plate, *balls = (body.mass for body in context.setup.free_bodies)
    ball = balls[0]
    drag = context.trace.pairs[0].friction[:, 0] * (plate + sum(balls)) * gravity(context)
    surplus = context.setting("force") - drag
    push = surplus / plate / (_SPHERE / ball + len(balls) / plate)
    return (surplus - len(balls) * push) / plate, push / ball


def _velocity_error(context: Context, index: int, acceleration: Floats) -> Floats:
    """Return (n,) the squared velocity error [m^2/s^2] of a free body, averaged over time."""
    start = context.setup.free_bodies[index].dof
    velocity = context.trace.qvel[:, 1:, start : start + 3]
    angle = np.radians(context.setting("direction"))
    heading = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    pace = acceleration[:, None] * (context.trace.time[:, 1:] - context.trace.time[:, :1])
    error = velocity - pace[:, :, None] * heading[:, None]
    return (error * error).sum(axis=2).mean(axis=1)
