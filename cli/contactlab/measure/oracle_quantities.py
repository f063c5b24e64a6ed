"""Quantities that several oracles read: friction, gravity, motion as the engine integrates it."""

import numpy as np
from numpy.typing import ArrayLike

from contactlab.contact import Floats, damping_ratio, restitution_of
from contactlab.measure.context import Context


def distance_from_rest(context: Context, steps: ArrayLike) -> Floats:
    """Return (n, ...) the distance [m] that 1 m/s^2 moves a body from rest in this many steps.

    A semi-implicit step adds h a to the velocity and then h v to the position, so that N steps
    move by ``a h^2 N (N + 1) / 2``; RK4 by ``a (h N)^2 / 2``.
    """
    count = np.asarray(steps, dtype=np.float64)
    one = (slice(None),) + (None,) * count.ndim
    step = context.trace.timestep[one]
    return step**2 * count * (count + semi_implicit(context)[one]) / 2


def semi_implicit(context: Context) -> Floats:
    """Return (n,) 1 where positions move with the velocity after a step, 0 for RK4."""
    return np.array([name != "RK4" for name in context.setup.settings["integrator"]], np.float64)


def displacement(context: Context) -> Floats:
    """Return (n, 3) the displacement [m] of the first free body over the run."""
    start = context.setup.free_bodies[0].qpos
    place = context.trace.qpos[:, :, start : start + 3]
    return place[:, -1] - place[:, 0]


def along_direction(context: Context, vectors: Floats) -> Floats:
    """Return (n,) the part of vectors (n, 3) along the scene's `direction` about the vertical."""
    angle = np.radians(context.setting("direction"))
    return vectors[:, 0] * np.cos(angle) + vectors[:, 1] * np.sin(angle)


def friction(context: Context, place: int = 0) -> Floats:
    """Return (n,) a friction coefficient: sliding [1], or at place 2 torsional, 3 rolling [m]."""
    return context.setting("friction").reshape(context.trace.runs, -1)[:, place]


def gravity(context: Context) -> Floats:
    """Return (n,) the magnitude of gravity [m/s^2]."""
    return np.linalg.norm(context.setup.gravity, axis=1)


def restitution_of_solref(context: Context) -> Floats:
    """Return (n,) the restitution that follows from the damping ratio of solref."""
    return restitution_of(damping_ratio(context.setting("solref")))


def end_velocity(context: Context, body: int, state: int = -1) -> Floats:
    """Return (n, 3) the velocity [m/s] of a free body in a state, by default the last."""
    start = context.setup.free_bodies[body].dof
    return context.trace.qvel[:, state, start : start + 3]
