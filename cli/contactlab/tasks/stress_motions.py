"""Motions besides those of the task, under load: gravity tilted, and twice the inputs."""

import copy
import hashlib
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import mujoco
import numpy as np

from contactlab.budget import Motion
from contactlab.budget.windows import replay_motion
from contactlab.contact.trace_arrays import Floats

TILT_DEGREES = 20.0  # degrees


def tilt_gravity(motion: Motion, sign: float = 1.0) -> Motion:
    """Return a motion with gravity tilted, from the same starts, with the same inputs.

    A sign of -1 tilts it the other way.
    """
    return replace(motion, model=tilt_model(motion.model, sign), name=f"{motion.name}, tilted")


def tilt_model(model: mujoco.MjModel, sign: float = 1.0) -> mujoco.MjModel:
    """Return a copy of a model with gravity tilted; a sign of -1 tilts it the other way."""
    tilted, angle = copy.copy(model), math.radians(TILT_DEGREES)
    down = np.array(tilted.opt.gravity)
    size = float(np.linalg.norm(down))
    aside = np.cross(down, [0.0, 1.0, 0.0] if abs(down[1]) < 0.9 * size else [1.0, 0.0, 0.0])
    if size > 0:
        aside *= sign * size / float(np.linalg.norm(aside))
        tilted.opt.gravity[:] = math.cos(angle) * down + math.sin(angle) * aside
    return tilted


def double_inputs(motion: Motion) -> Motion:
    """Return a motion with twice the controls and pushes, which actuators may clamp."""
    return replace(motion, inputs=2 * motion.inputs, name=f"{motion.name}, doubled")


class KnownStates:
    """The states of motions, which those of changed models are compared with bit for bit.

    Each motion is run when its states are first needed. Most changed models differ after a few
    steps, and many at the first contact, so that ever more of the first steps of all motions are
    compared before whole motions.
    """

    def __init__(self, motions: Sequence[Motion], workers: int) -> None:
        """Run nothing yet."""
        self.motions, self._workers = motions, workers
        # A model that moves otherwise usually shows it in 20 steps. Each next part is five times as
        # long, so that all parts together take a quarter more than whole motions.
        longest = max(motion.steps for motion in motions)
        lengths = list(itertools.takewhile(lambda steps: steps < longest, (20, 100, 500, 2500)))
        self._parts = [
            replace(motion, inputs=motion.inputs[:, :steps])
            for steps in lengths
            for motion in motions
        ]
        self._known = dict[int, bytes]()

    def match_models(self, models: Sequence[mujoco.MjModel]) -> bool:
        """Return whether each bit of the motion of these models is equal, one model a motion."""
        pairs = zip(self.motions, models, strict=True)
        return self.match_motions([replace(motion, model=model) for motion, model in pairs])

    def match_motions(self, others: Sequence[Motion]) -> bool:
        """Return whether each bit of other motions of the same length is equal."""
        pairs = zip([*self._parts, *self.motions], itertools.cycle(others), strict=False)
        return all(
            self._find_digest(own)
            == _digest_states(
                visit_states(replace(other, inputs=other.inputs[:, : own.steps]), self._workers)
            )
            for own, other in pairs
        )

    def list_positions(self) -> Iterator[Floats]:
        """Yield the configurations (T, nq) of each motion before each step."""
        for motion in self.motions:
            states = visit_states(motion, self._workers)
            self._known[id(motion)] = _digest_states(states)
            positions = states[:, :-1, : motion.model.nq]
            yield positions[np.isfinite(positions).all(axis=2)]

    def _find_digest(self, motion: Motion) -> bytes:
        if id(motion) not in self._known:
            self._known[id(motion)] = _digest_states(visit_states(motion, self._workers))
        return self._known[id(motion)]


def _digest_states(states: Floats) -> bytes:
    # States of large scenes take half a gigabyte.
    return hashlib.sha256(states.tobytes()).digest()


def visit_states(motion: Motion, workers: int) -> Floats:
    """Return the states (S, N + 2, kept) of a motion before each step, and after the last."""
    length = motion.steps * float(motion.model.opt.timestep)
    return replay_motion(motion, length, workers).velocity_states


def join_seeds(one: Motion, other: Motion) -> Motion:
    """Return a motion with the seeds of two motions of the same phase."""
    starts, inputs = (
        np.concatenate([getattr(one, name), getattr(other, name)]) for name in ("starts", "inputs")
    )
    return replace(one, starts=starts, inputs=inputs)
