"""Closed forms of dry friction: sliding boxes, a ladder, a rod on one end, rolling balls."""

from dataclasses import dataclass

import numpy as np

from contactlab.contact.trace_arrays import Floats, squared_lengths
from contactlab.contact.trace_setup import FreeBody
from contactlab.measure.context import Context, distance_from_rest, friction, gravity, semi_implicit
from contactlab.measure.entries import oracle


@dataclass(frozen=True)
class _Rod:
    """The rod of the scene that stands on one end [m]."""

    half_length: float = 0.5
    radius: float = 0.01


_ROD = _Rod()


@oracle("m", ("speed", "friction", "timestep", "integrator"), relative=True)
def sliding_distance(context: Context) -> tuple[Floats, Floats]:
    """Distance D = v0^2 / (2 mu g) - v0 timestep / 2 that a box slides until friction stops it.

    Coulomb friction under semi-implicit Euler; RK4 has no second term. Measured: displacement
    across gravity of the first pair's free body over a run that lets it stop.
    """
    speed, fall = context.setting("speed"), gravity(context)
    early = np.where(semi_implicit(context) > 0, speed * context.setting("timestep") / 2, 0)
    barriers = [barrier.body for barrier in context.setup.barriers if barrier.pair == 0]
    moved = context.displacement((barriers or context.setup.free_bodies)[0])
    down = context.setup.gravity / fall[:, None]
    across = moved - (moved * down).sum(axis=1, keepdims=True) * down
    expected = speed**2 / (2 * friction(context) * fall) - early
    return expected, np.linalg.norm(across, axis=1)


@oracle("1", ("tilt", "weight", "direction", "friction", "integrator"), relative=False)
def incline(context: Context) -> tuple[Floats, Floats]:
    """Share max(1 - mu N / F, 0) of its frictionless travel that a box slides down a slope.

    F = `weight` sin(tilt) and N = `weight` cos(tilt); without friction F moves it by F t^2 / (2 m)
    (Coulomb; t^2 is (h n) h (n + 1) after n semi-implicit steps). Measured: displacement of the
    first free body along the load over that travel; creep in soft contact counts.
    """
    tilt = np.radians(context.setting("tilt"))
    weight = context.setting("weight") / context.setup.free_bodies[0].mass
    return _moved_share(context, weight * np.sin(tilt), weight * np.cos(tilt))


@oracle("1", ("push", "direction", "friction", "integrator"), relative=False)
def pushed_box(context: Context) -> tuple[Floats, Floats]:
    """Share max(1 - mu m g / F, 0) of its frictionless travel that a pushed box slides.

    F = `push`; without friction it moves the box as in incline. Measured: as in incline.
    """
    load = context.setting("push") / context.setup.free_bodies[0].mass
    return _moved_share(context, load, gravity(context))


def _moved_share(context: Context, load: Floats, pressure: Floats) -> tuple[Floats, Floats]:
    """Return a load's travel over its frictionless travel, expected and measured.

    Load and pressure are over mass [m/s^2].
    """
    angle = np.radians(context.setting("direction"))
    moved = context.displacement(context.setup.free_bodies[0])
    along = moved[:, 0] * np.cos(angle) + moved[:, 1] * np.sin(angle)
    expected = np.maximum(1 - friction(context) * pressure / load, 0)
    return expected, along / (load * distance_from_rest(context, context.trace.steps))


@oracle("1", ("angle", "friction"), relative=False)
def ladder(context: Context) -> tuple[Floats, Floats]:
    """Whether a ladder on a rough floor falls along a smooth wall: 1 if so, 0 if it stands.

    A uniform ladder of L = 1 m with ends of radius r stands while tan(angle) <= 2 mu (1 + r / (L
    cos(angle))), the angle from the vertical (moments about the foot). Measured: the increase of
    the angle, by the third degree of freedom, over 5 degrees, at most 1.
    """
    angle, radius = np.radians(context.setting("angle")), context.setup.thickness[0]
    ladder_length = 1.0
    grip = 2 * friction(context) * (1 + radius / (ladder_length * np.cos(angle)))
    lean_index = 2
    lean = context.trace.qpos[:, :, lean_index]
    fall_angle_rad = np.radians(5)
    gained = (lean[:, -1] - lean[:, 0]) / fall_angle_rad
    return np.where(np.tan(angle) > grip, 1.0, 0.0), np.minimum(gained, 1)


@oracle("m", ("friction",), relative=False)
def tip_travel(context: Context) -> tuple[Floats, Floats]:
    """Distance that a rod of 1 m, free in a plane, slides on its round end of 10 mm radius.

    Newton's laws with N = m (g - l sin w^2) / (1 + 3 cos (cos + mu sin)) and friction mu N against
    the slip, integrated to second order; mu is negative if the end leads. An end that stops stays,
    and stops at once if N would be negative (Painlevé; J. J. Moreau calls it a frictional
    catastrophe). Joints are x, z and angle, in this order. Measured: the end's travel over the
    whole run.
    """
    states = context.trace.qpos, context.trace.qvel
    start, last = (
        np.stack([values[:, state, axis] for values in states for axis in (0, 2)])
        for state in (0, -1)
    )
    mu = context.setting("friction")[:, 0]
    expected = rod_tip_travel(start, mu, gravity(context), context.seconds)
    return expected, _end_position(last) - _end_position(start)


def rod_tip_travel(rod: Floats, mu: Floats, fall: Floats, duration: Floats) -> Floats:
    """Return (n,) how far the touching end's center moves [m]; it stays after it stops or jams.

    `rod` (4, n) holds the position of its center along the floor [m], its angle over the floor
    [rad], and the rates of both; `mu` (n,) is the end's friction, `fall` gravity [m/s^2], and time
    is in s.
    """
    integration_steps = 100
    forward, step = np.sign(_slip_speed(rod)), duration / integration_steps
    drag = forward * mu
    stuck = np.zeros(len(mu), dtype=np.bool_)
    travel, place = np.zeros(len(mu)), _end_position(rod)
    for _ in range(integration_steps):
        middle = rod + step / 2 * _rod_rates(rod, drag, fall)
        rod = rod + step * _rod_rates(middle, drag, fall)
        stuck |= (tip_compliance(rod[1], drag) <= 0) | (_slip_speed(rod) * forward <= 0)
        travel, place = travel + np.where(stuck, 0, _end_position(rod) - place), _end_position(rod)
    return travel


def _slip_speed(rod: Floats) -> Floats:
    """Return (n,) speed of the rod's material at the contact [m/s]."""
    _, angle, speed, turning = rod
    return speed + (_ROD.half_length * np.sin(angle) + _ROD.radius) * turning


def tip_compliance(angle: Floats, drag: Floats) -> Floats:
    """Return (n,) mass times acceleration of the touching end by a normal force, over that force.

    A thin rod of length 2 l has inertia m l^2 / 3 about its center. If the result is not positive,
    pressing the end pulls it down, and no normal force can hold it: Painlevé's paradox. `drag` is
    the friction coefficient with the sign of the slip speed, `angle` [rad] is over the floor.
    """
    across, up = np.cos(angle), np.sin(angle) + _ROD.radius / _ROD.half_length
    return 1 + 3 * across * (across + drag * up)


def _rod_rates(rod: Floats, drag: Floats, fall: Floats) -> Floats:
    _, angle, speed, turning = rod
    across, up = np.cos(angle), np.sin(angle)
    sink = fall - _ROD.half_length * up * turning**2
    normal = np.maximum(sink, 0) / tip_compliance(angle, drag)
    arm = across + drag * (up + _ROD.radius / _ROD.half_length)
    return np.stack([speed, turning, -drag * normal, -3 / _ROD.half_length * arm * normal])


def _end_position(rod: Floats) -> Floats:
    return rod[0] - _ROD.half_length * np.cos(rod[1])


@oracle("1", ("tilt", "weight", "direction", "friction", "integrator"), relative=True)
def roll_down(context: Context) -> tuple[Floats, Floats]:
    """Share of its frictionless travel that a homogeneous sphere rolls down a slope: 5/7.

    If mu >= (2/7) tan(tilt); otherwise 1 - mu / tan(tilt). Measured: displacement of the first free
    body down the slope over g sin(tilt) t^2 / 2, with m g the scene's `weight`.
    """
    tilt = np.radians(context.setting("tilt"))
    weight = context.setting("weight") / context.setup.free_bodies[0].mass
    _, moved = _moved_share(context, weight * np.sin(tilt), weight * np.cos(tilt))
    return np.maximum(5 / 7, 1 - friction(context) / np.tan(tilt)), moved


@oracle("s", ("friction",), relative=True)
def slide_to_roll(context: Context) -> tuple[Floats, Floats]:
    """Time until a homogeneous sphere that starts to slide at v0 without turning rolls.

    It slips at v0 - (7/2) mu g t. Measured: time when |v| - r |w| of the first free body is 5 % of
    v0.
    """
    speed = _body_speed(context)
    slip = speed - context.setup.thickness[0] * _body_angular_speed(context)
    # A ball rolls below this share of its initial slip; soft contact creeps by less.
    rolling_slip_share = 0.05
    rolls = slip <= rolling_slip_share * speed[:, :1]
    time = rolls.argmax(axis=1) * context.trace.timestep
    stop = 2 * speed[:, 0] / (7 * friction(context) * gravity(context))
    return (1 - rolling_slip_share) * stop, np.where(rolls.any(axis=1), time, np.nan)


@oracle("m/s^2", ("friction",), relative=True)
def roll_friction(context: Context) -> tuple[Floats, Floats]:
    """Deceleration mu_r g / (1.4 r) of a homogeneous sphere of radius r that rolls.

    The moment mu_r N turns m r^2 7/5. Measured: mean deceleration of the first free body, which
    must not stop within the run.
    """
    speed, radius = _body_speed(context), context.setup.thickness[0]
    expected = friction(context, 3) * gravity(context) / (1.4 * radius)
    return expected, (speed[:, 0] - speed[:, -1]) / context.seconds


@oracle("rad/s^2", ("friction",), relative=True)
def spin_down(context: Context) -> tuple[Floats, Floats]:
    """Angular deceleration mu_t g / (0.4 r^2) of a homogeneous sphere that spins on the spot.

    The moment mu_t N about the normal turns m r^2 2/5. Measured: mean angular deceleration of the
    first free body, which must not stop within the run.
    """
    rate, radius = _body_angular_speed(context), context.setup.thickness[0]
    expected = friction(context, 2) * gravity(context) / (0.4 * radius**2)
    return expected, (rate[:, 0] - rate[:, -1]) / context.seconds


@oracle("m^2/s^2", ("force", "direction"), relative=False)
def rolling_plate(context: Context) -> tuple[Floats, Floats]:
    """Squared velocity error of a plate pulled over the ground and of balls that roll on it: 0.

    A plate M, pulled by F and carrying n homogeneous balls m, slides with f1 = mu (M + n m) g;
    balls that roll on it take f2 = ((F - f1) / M) / (3.5 / m + n / M) each. So it accelerates at (F
    - f1 - n f2) / M and a ball at f2 / m. Measured: squared velocity errors of the plate and of a
    ball, averaged over time (and over the balls) and added.
    """
    plate, *balls = context.setup.free_bodies
    mass, count = balls[0].mass, len(balls)
    whole = plate.mass + sum(ball.mass for ball in balls)
    drag = context.trace.pairs[0].friction[:, 0] * whole * gravity(context)
    surplus = context.setting("force") - drag
    sphere_factor = 3.5  # 1 + m r^2 / I of a homogeneous sphere
    push = surplus / plate.mass / (sphere_factor / mass + count / plate.mass)
    error = _velocity_error(context, plate, (surplus - count * push) / plate.mass)
    errors = [_velocity_error(context, ball, push / mass) for ball in balls]
    return np.zeros_like(error), error + sum(errors, np.zeros_like(error)) / count


def _body_speed(context: Context) -> Floats:
    return np.sqrt(squared_lengths(context.velocity(context.setup.free_bodies[0])))


def _body_angular_speed(context: Context) -> Floats:
    return np.sqrt(squared_lengths(context.turning(context.setup.free_bodies[0])))


def _velocity_error(context: Context, body: FreeBody, acceleration: Floats) -> Floats:
    """Return (n,) the squared velocity error [m^2/s^2] of a body, averaged over time."""
    angle = np.radians(context.setting("direction"))
    heading = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    pace = acceleration[:, None] * (context.trace.time[:, 1:] - context.trace.time[:, :1])
    error = context.velocity(body)[:, 1:] - pace[:, :, None] * heading[:, None]
    return (error * error).sum(axis=2).mean(axis=1)
