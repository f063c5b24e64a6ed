"""A plate pulled over the ground, and balls that roll on it."""

import numpy as np

from contactlab.contact import Floats
from contactlab.measure.context import Context
from contactlab.measure.oracles.oracle import Oracle, setting

_SPHERE = 3.5
"""1 + m r^2 / I of a homogeneous sphere."""


def _rolling_plate(context: Context) -> tuple[Floats, Floats]:
    of_plate, of_ball = _accelerations(context)
    plate = _velocity_error(context, 0, of_plate)
    balls = range(1, len(context.setup.free_bodies))
    ball = np.mean([_velocity_error(context, index, of_ball) for index in balls], axis=0)
    return np.zeros_like(plate), plate + ball


def _accelerations(context: Context) -> tuple[Floats, Floats]:
    """Return (n,) the accelerations [m/s^2] of the plate and of a ball along the pull."""
    plate, *balls = (body.mass for body in context.setup.free_bodies)
    ball, gravity = balls[0], np.linalg.norm(context.setup.gravity, axis=1)
    friction = context.trace.pairs[0].friction[:, 0] * (plate + sum(balls)) * gravity
    surplus = setting(context, "force") - friction
    push = surplus / plate / (_SPHERE / ball + len(balls) / plate)
    return (surplus - len(balls) * push) / plate, push / ball


def _velocity_error(context: Context, index: int, acceleration: Floats) -> Floats:
    """Return (n,) the squared velocity error [m^2/s^2] of a free body, averaged over time."""
    start = context.setup.free_bodies[index].dof
    velocity = context.trace.qvel[:, 1:, start : start + 3]
    angle = np.radians(setting(context, "direction"))
    heading = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    pace = acceleration[:, None] * (context.trace.time[:, 1:] - context.trace.time[:, :1])
    error = velocity - pace[:, :, None] * heading[:, None]
    return (error * error).sum(axis=2).mean(axis=1)


ROLLING_PLATE = Oracle(
    name="rolling_plate",
    unit="m^2/s^2",
    relative=False,
    definition=(
        "A plate of mass M that is pulled by F and carries n homogeneous balls of mass m slides "
        "with f1 = mu (M + n m) g; balls that roll on it without slipping take "
        "f2 = ((F - f1) / M) / (3.5 / m + n / M) each. So the plate accelerates at "
        "(F - f1 - n f2) / M and a ball at f2 / m. Expected: no error. Measured: the squared "
        "velocity error of the plate and of a ball, averaged over time (and over the balls) and "
        "added."
    ),
    settings=("force", "direction"),
    function=_rolling_plate,
)
