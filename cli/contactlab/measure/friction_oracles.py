"""Closed forms of dry friction: sliding boxes, a ladder, and a rod on one end."""

from typing import NamedTuple

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.measure.context import Context
from contactlab.measure.entries import oracle
from contactlab.measure.oracle_error import (
    along_direction,
    displacement,
    distance_from_rest,
    friction,
    gravity,
    semi_implicit,
)

_LADDER_LENGTH = 1.0
_LEAN = 2
_FALLEN = np.radians(5)
_HALF_LENGTH = 0.5
_RADIUS = 0.01
_STEPS = 100


@oracle(unit="m", settings=("speed", "friction", "timestep", "integrator"), relative=True)
def sliding_distance(context: Context) -> tuple[Floats, Floats]:
    """Distance D = v0^2 / (2 mu g) - v0 timestep / 2 that a box slides until friction stops it.

    Coulomb friction under semi-implicit Euler, which applies it before it moves the box; RK4 has
    no second term. Measured: displacement across gravity of the first pair's free body over the
    whole run, which must be long enough for it to stop.
    """
    speed, fall = context.setting("speed"), gravity(context)
    early = np.where(semi_implicit(context) > 0, speed * context.setting("timestep") / 2, 0)
    barriers = [each.body for each in context.setup.barriers if each.pair == 0]
    start = (barriers or context.setup.free_bodies)[0].qpos
    ends = context.trace.qpos[:, [0, -1], start : start + 3]
    moved = ends[:, 1] - ends[:, 0]
    down = context.setup.gravity / fall[:, None]
    across = moved - (moved * down).sum(axis=1, keepdims=True) * down
    expected = speed**2 / (2 * friction(context) * fall) - early
    return expected, np.linalg.norm(across, axis=1)


@oracle(
    unit="1", settings=("tilt", "weight", "direction", "friction", "integrator"), relative=False
)
def incline(context: Context) -> tuple[Floats, Floats]:
    """Share max(1 - mu N / F, 0) of its frictionless way that a box slides down a slope.

    On a slope of the angle `tilt`, F = `weight` sin(tilt) and N = `weight` cos(tilt). Without
    friction F moves the box by F t^2 / (2 m) (Coulomb; t^2 is (h n) h (n + 1) after n
    semi-implicit steps). Measured: displacement of the first free body along the load over that
    way. What sticks creeps in soft contact, and that counts.
    """
    tilt = np.radians(context.setting("tilt"))
    weight = context.setting("weight") / context.setup.free_bodies[0].mass
    return _moved_share(context, weight * np.sin(tilt), weight * np.cos(tilt))


@oracle(unit="1", settings=("push", "direction", "friction", "integrator"), relative=False)
def pushed_box(context: Context) -> tuple[Floats, Floats]:
    """Share max(1 - mu m g / F, 0) of its frictionless way that a pushed box slides.

    Pushed by F = `push`. Without friction F moves the box by F t^2 / (2 m) (Coulomb; t^2 is
    (h n) h (n + 1) after n semi-implicit steps). Measured: displacement of the first free body
    along the load over that way. What sticks creeps in soft contact, and that counts.
    """
    load = context.setting("push") / context.setup.free_bodies[0].mass
    return _moved_share(context, load, gravity(context))


def _moved_share(context: Context, load: Floats, pressure: Floats) -> tuple[Floats, Floats]:
    """Return what a load moves, with friction, of the way that it would go without.

    Both loads, tangential and normal, are over mass (n,) [m/s^2].
    """
    free = load * distance_from_rest(context, context.trace.steps)
    expected = np.maximum(1 - friction(context) * pressure / load, 0)
    return expected, along_direction(context, displacement(context)) / free


@oracle(unit="1", settings=("angle", "friction"), relative=False)
def ladder(context: Context) -> tuple[Floats, Floats]:
    """Whether a ladder on a rough floor falls along a smooth wall: 1 if so, 0 if it stands.

    A uniform ladder whose axis has the length L = 1 m, rounded with radius r at both ends, stands
    while tan(angle) <= 2 mu (1 + r / (L cos(angle))), the angle from the vertical (moments about
    the foot; the wall bears mu m g at most). Measured: the angle gained over 5 degrees, at most 1.
    The hinge is the third degree of freedom.
    """
    angle, radius = np.radians(context.setting("angle")), context.setup.thickness[0]
    grip = 2 * friction(context) * (1 + radius / (_LADDER_LENGTH * np.cos(angle)))
    lean = context.trace.qpos[:, :, _LEAN]
    gained = (lean[:, -1] - lean[:, 0]) / _FALLEN
    return np.where(np.tan(angle) > grip, 1.0, 0.0), np.minimum(gained, 1)


@oracle(unit="m", settings=("friction",), relative=False)
def tip_travel(context: Context) -> tuple[Floats, Floats]:
    """Distance that a rod of 1 m, free in a plane, slides on its round end of 10 mm radius.

    Newton's laws with N = m (g - l sin w^2) / (1 + 3 cos (cos + mu sin)) and friction mu N
    against the slip, integrated to second order; mu is negative where the end leads. An end that
    stops stays, and stops at once where N would be negative (Painlevé; J. J. Moreau calls it a
    frictional catastrophe). Joints are x, z and angle, in this order. Measured: the end's travel
    over the whole run.
    """
    position, velocity = context.trace.qpos, context.trace.qvel
    start, last = (
        Rod(position[:, k, 0], position[:, k, 2], velocity[:, k, 0], velocity[:, k, 2])
        for k in (0, -1)
    )
    mu = context.setting("friction")[:, 0]
    expected = rod_tip_travel(start, mu, gravity(context), context.seconds)
    return expected, _end(last) - _end(start)


class Rod(NamedTuple):
    """A state of n rods, (n,) each.

    Attributes:
        x: horizontal position of the centre [m].
        angle: of the rod over the floor [rad].
        speed: horizontal, of the centre [m/s].
        turning: angular velocity [rad/s].
    """

    x: Floats
    angle: Floats
    speed: Floats
    turning: Floats

    def advanced(self, rate: "Rod", time: Floats) -> "Rod":
        """Return the state after a time [s] at a rate of change."""
        return Rod(*(value + time * slope for value, slope in zip(self, rate, strict=True)))


def rod_tip_travel(rod: Rod, mu: Floats, fall: Floats, duration: Floats) -> Floats:
    """Return (n,) how far the touching end's centre moves [m]; it stays where it stops or jams.

    Friction `mu`, gravity `fall` [m/s^2] and duration [s] are (n,).
    """
    forward, step = np.sign(slip_speed(rod)), duration / _STEPS
    drag = forward * mu
    stuck = np.zeros(len(mu), dtype=np.bool_)
    travel, place = np.zeros(len(mu)), _end(rod)
    for _ in range(_STEPS):
        middle = rod.advanced(_rate(rod, drag, fall), step / 2)
        rod = rod.advanced(_rate(middle, drag, fall), step)
        stuck |= (tip_compliance(rod.angle, drag) <= 0) | (slip_speed(rod) * forward <= 0)
        travel, place = travel + np.where(stuck, 0, _end(rod) - place), _end(rod)
    return travel


def slip_speed(rod: Rod) -> Floats:
    """Return (n,) speed of the rod's material where it touches [m/s]."""
    return rod.speed + (_HALF_LENGTH * np.sin(rod.angle) + _RADIUS) * rod.turning


def tip_compliance(angle: Floats, drag: Floats) -> Floats:
    """Return (n,) mass times acceleration of the touching end by a normal force, over that force.

    A thin rod of length 2 l has inertia m l^2 / 3 about its centre. Where this is not positive,
    pressing the end pulls it down, and no normal force can hold it: Painlevé's paradox. `drag` is
    the friction coefficient with the sign of the slip speed, `angle` [rad] is over the floor.
    """
    across, up = np.cos(angle), np.sin(angle) + _RADIUS / _HALF_LENGTH
    return 1 + 3 * across * (across + drag * up)


def _rate(rod: Rod, drag: Floats, fall: Floats) -> Rod:
    across, up = np.cos(rod.angle), np.sin(rod.angle)
    sink = fall - _HALF_LENGTH * up * rod.turning**2
    normal = np.maximum(sink, 0) / tip_compliance(rod.angle, drag)
    arm = across + drag * (up + _RADIUS / _HALF_LENGTH)
    return Rod(rod.speed, rod.turning, -drag * normal, -3 / _HALF_LENGTH * arm * normal)


def _end(rod: Rod) -> Floats:
    return rod.x - _HALF_LENGTH * np.cos(rod.angle)
