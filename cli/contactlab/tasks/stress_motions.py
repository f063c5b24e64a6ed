"""Motions besides those of the task, under load: gravity tilted, and twice the inputs."""

import copy
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import mujoco
import numpy as np

from contactlab.budget import Motion
from contactlab.budget.windows import replay
from contactlab.contact.trace_arrays import Floats

TILT_DEGREES = 20.0  # degrees


def tilt_gravity(motion: Motion, sign: float = 1.0) -> Motion:
    """Return a motion with gravity tilted, from the same starts, with the same inputs.

    A sign of -1 tilts it the other way.
    """
    return replace(motion, model=tilt_model(motion.model, sign), name=f"{motion.name}, tilted")


def tilt_model(model: mujoco.MjModel, sign: float = 1.0) -> mujoco.MjModel:
    """Return a copy of a model with gravity tilted; a sign of -1 tilts it the other way."""
    made, angle = copy.copy(model), math.radians(TILT_DEGREES)
    down = np.array(made.opt.gravity)
    size = float(np.linalg.norm(down))
    aside = np.cross(down, [0.0, 1.0, 0.0] if abs(down[1]) < 0.9 * size else [1.0, 0.0, 0.0])
    if size > 0:
        aside *= sign * size / float(np.linalg.norm(aside))
        made.opt.gravity[:] = math.cos(angle) * down + math.sin(angle) * aside
    return made


def double_inputs(motion: Motion) -> Motion:
    """Return a motion with twice the controls and pushes, which actuators may clamp."""
    return replace(motion, inputs=2 * motion.inputs, name=f"{motion.name}, doubled")


def state_bytes(motions: Sequence[Motion], workers: int) -> Iterator[bytes]:
    """Yield the bytes of all states of each motion."""
    return (whole.tobytes() for whole in _visited_states(motions, workers))


def visited_positions(motions: Sequence[Motion], workers: int) -> Iterator[Floats]:
    """Yield the configurations (T, nq) of motions before each step."""
    for motion, whole in zip(motions, _visited_states(motions, workers), strict=True):
        kept = whole[:, :-1, : motion.model.nq]
        yield kept[np.isfinite(kept).all(axis=2)]


def _visited_states(motions: Sequence[Motion], workers: int) -> Iterator[Floats]:
    """Yield the states (S, N + 2, kept) of motions."""
    for motion in motions:
        length = motion.steps * float(motion.model.opt.timestep)
        yield replay(motion, length, workers).kept


def join_seeds(one: Motion, other: Motion) -> Motion:
    """Return a motion with the seeds of two motions of the same phase."""
    starts, inputs = (
        np.concatenate([getattr(one, name), getattr(other, name)]) for name in ("starts", "inputs")
    )
    return replace(one, starts=starts, inputs=inputs)
