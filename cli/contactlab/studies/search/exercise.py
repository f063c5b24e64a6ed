"""Motions beside those of the task, under load: gravity tilted, twice the inputs."""

import copy
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from contactlab.budget import Motion
from contactlab.budget.windows import replay
from contactlab.contact.trace_arrays import Floats

TILT = 20.0  # degrees


def tilted(motion: Motion) -> Motion:
    """Return a motion whose gravity is tilted, from the same starts, with the same inputs."""
    model, angle = copy.copy(motion.model), math.radians(TILT)
    down = np.array(model.opt.gravity)
    size = float(np.linalg.norm(down))
    aside = np.cross(down, [0.0, 1.0, 0.0] if abs(down[1]) < 0.9 * size else [1.0, 0.0, 0.0])
    if size > 0:
        aside *= size / float(np.linalg.norm(aside))
        model.opt.gravity[:] = math.cos(angle) * down + math.sin(angle) * aside
    return replace(motion, model=model, name=f"{motion.name}, tilted")


def doubled(motion: Motion) -> Motion:
    """Return a motion by twice the controls and pushes, which actuators clamp where they do."""
    return replace(motion, inputs=2 * motion.inputs, name=f"{motion.name}, doubled")


def bits_of(motions: Sequence[Motion], workers: int) -> Iterator[bytes]:
    """Yield the bits of all states that each motion goes through."""
    return (whole.tobytes() for whole in _whole(motions, workers))


def positions_of(motions: Sequence[Motion], workers: int) -> Iterator[Floats]:
    """Yield configurations (T, nq) that motions go through, before each step."""
    for motion, whole in zip(motions, _whole(motions, workers), strict=True):
        kept = whole[:, :-1, : motion.model.nq]
        yield kept[np.isfinite(kept).all(axis=2)]


def _whole(motions: Sequence[Motion], workers: int) -> Iterator[Floats]:
    """Yield the states (S, N + 2, kept) that motions go through."""
    for motion in motions:
        length = motion.steps * float(motion.model.opt.timestep)
        yield replay(motion, length, workers).kept


def joined_seeds(one: Motion, other: Motion) -> Motion:
    """Return a motion with the seeds of two of the same phase."""
    starts, inputs = (
        np.concatenate([getattr(one, name), getattr(other, name)]) for name in ("starts", "inputs")
    )
    return replace(one, starts=starts, inputs=inputs)
