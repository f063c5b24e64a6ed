"""How far the end of a rod slides, by rigid mechanics."""

from typing import NamedTuple

import numpy as np

from contactlab.contact import Floats
from contactlab.measure.context import Context
from contactlab.measure.oracles.oracle import Oracle, setting

_HALF_LENGTH = 0.5
_RADIUS = 0.01
_STEPS = 100


class Rod(NamedTuple):
    """A state of n rods: centre [m], angle [rad] and their velocities [m/s, rad/s], (n,) each."""

    x: Floats
    angle: Floats
    speed: Floats
    spin: Floats

    def moved(self, rate: "Rod", time: Floats) -> "Rod":
        """Return the state after a time [s] at a rate of change."""
        return Rod(*(value + time * slope for value, slope in zip(self, rate, strict=True)))


def slip_speed(rod: Rod) -> Floats:
    """Return (n,) speed of the rod's material where it touches [m/s]."""
    return rod.speed + (_HALF_LENGTH * np.sin(rod.angle) + _RADIUS) * rod.spin


def compliance(angle: Floats, drag: Floats) -> Floats:
    """Return (n,) mass times acceleration of the touching end by a normal force, over that force.

    A thin rod of length 2 l has inertia m l^2 / 3 about its centre. Where this is not positive,
    pressing the end pulls it down, and no normal force can hold it: Painlevé's paradox.

    Args:
        angle: (n,) angle of the rod over the floor [rad].
        drag: (n,) friction coefficient with the sign of the slip speed.
    """
    across, up = np.cos(angle), np.sin(angle) + _RADIUS / _HALF_LENGTH
    return 1 + 3 * across * (across + drag * up)


def _rate(rod: Rod, drag: Floats, gravity: Floats) -> Rod:
    across, up = np.cos(rod.angle), np.sin(rod.angle)
    sink = gravity - _HALF_LENGTH * up * rod.spin**2
    normal = np.maximum(sink, 0) / compliance(rod.angle, drag)
    arm = across + drag * (up + _RADIUS / _HALF_LENGTH)
    return Rod(rod.speed, rod.spin, -drag * normal, -3 / _HALF_LENGTH * arm * normal)


def tip_travel(rod: Rod, friction: Floats, gravity: Floats, duration: Floats) -> Floats:
    """Return (n,) how far the touching end's centre moves [m]; it stays where it stops or jams."""
    forward, step = np.sign(slip_speed(rod)), duration / _STEPS
    drag = forward * friction
    stuck = np.zeros(len(friction), dtype=np.bool_)
    travel, place = np.zeros(len(friction)), _end(rod)
    for _ in range(_STEPS):
        middle = rod.moved(_rate(rod, drag, gravity), step / 2)
        rod = rod.moved(_rate(middle, drag, gravity), step)
        stuck |= (compliance(rod.angle, drag) <= 0) | (slip_speed(rod) * forward <= 0)
        travel, place = travel + np.where(stuck, 0, _end(rod) - place), _end(rod)
    return travel


def _end(rod: Rod) -> Floats:
    return rod.x - _HALF_LENGTH * np.cos(rod.angle)


def _tip_travel(context: Context) -> tuple[Floats, Floats]:
    position, velocity = context.trace.qpos, context.trace.qvel
    start, last = (
        Rod(position[:, k, 0], position[:, k, 2], velocity[:, k, 0], velocity[:, k, 2])
        for k in (0, -1)
    )
    friction = setting(context, "friction")[:, 0]
    gravity = np.linalg.norm(context.setup.gravity, axis=1)
    return tip_travel(start, friction, gravity, context.seconds), _end(last) - _end(start)


TIP_TRAVEL = Oracle(
    name="tip_travel",
    unit="m",
    relative=False,
    definition=(
        "How far a rod of 1 m, free in a plane, slides on its round end of 10 mm: Newton's laws "
        "with N = m (g - l sin w^2) / (1 + 3 cos (cos + mu sin)) and friction mu N against the "
        "slip, integrated to second order; mu is negative where the end leads. An end that stops "
        "stays, and stops at once where N would be negative (Painlevé; J. J. Moreau calls it a "
        "frictional catastrophe). Joints are x, z and angle, in this order. Measured: the end's "
        "travel over the whole run."
    ),
    settings=("friction",),
    function=_tip_travel,
)
