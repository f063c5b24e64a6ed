"""What oracles of moving bodies share: steady acceleration as the engine integrates it."""

import numpy as np
from numpy.typing import ArrayLike

from contactlab.contact import Floats
from contactlab.measure.context import Context
from contactlab.measure.oracles.oracle import setting


def semi_implicit(context: Context) -> Floats:
    """Return (n,) 1 where places move with the velocity after a step, 0 for RK4."""
    return np.array([name != "RK4" for name in context.setup.settings["integrator"]], np.float64)


def pulled(context: Context, steps: ArrayLike) -> Floats:
    """Return (n, ...) the distance [m] that 1 m/s^2 moves a body from rest in this many steps.

    A semi-implicit step adds h a to the velocity and then h v to the place, so that N steps move
    by ``a h^2 N (N + 1) / 2``; RK4 by ``a (h N)^2 / 2``.
    """
    count = np.asarray(steps, dtype=np.float64)
    one = (slice(None),) + (None,) * count.ndim
    step = context.trace.timestep[one]
    return step**2 * count * (count + semi_implicit(context)[one]) / 2


def moved(context: Context) -> Floats:
    """Return (n, 3) how far [m] the first free body is at the end from where it started."""
    start = context.setup.free_bodies[0].qpos
    place = context.trace.qpos[:, :, start : start + 3]
    return place[:, -1] - place[:, 0]


def speed(context: Context) -> Floats:
    """Return (n, N + 1) the speed [m/s] of the first free body."""
    dof = context.setup.free_bodies[0].dof
    return np.linalg.norm(context.trace.qvel[:, :, dof : dof + 3], axis=2)


def spin(context: Context) -> Floats:
    """Return (n, N + 1) the rate of rotation [rad/s] of the first free body."""
    dof = context.setup.free_bodies[0].dof + 3
    return np.linalg.norm(context.trace.qvel[:, :, dof : dof + 3], axis=2)


def along(context: Context, vectors: Floats) -> Floats:
    """Return (n,) the part of vectors (n, 3) along the scene's `direction` about the vertical."""
    angle = np.radians(setting(context, "direction"))
    return vectors[:, 0] * np.cos(angle) + vectors[:, 1] * np.sin(angle)


def sliding_friction(context: Context) -> Floats:
    """Return (n,) the coefficient of sliding friction."""
    return setting(context, "friction").reshape(context.trace.runs, -1)[:, 0]


def fall(context: Context) -> Floats:
    """Return (n,) the magnitude of gravity [m/s^2]."""
    return np.linalg.norm(context.setup.gravity, axis=1)
