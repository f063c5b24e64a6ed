"""Start states: the model's own, what initial values set, and what a seed perturbs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from contactlab.errors import SceneError
from contactlab.plan import Expression
from contactlab.scene.base import perturbed_coordinates
from contactlab.scene.coordinates import match
from contactlab.schema import SceneManifest
from contactlab.trace import Floats

# Where a joint's quaternion starts within its part of qpos.
_ROTATIONS = {int(mujoco.mjtJoint.mjJNT_FREE): 3, int(mujoco.mjtJoint.mjJNT_BALL): 0}


@dataclass(frozen=True)
class StartState:
    """How the start states of one structure are made.

    Attributes:
        state: (nq + nv,) the model's start state, or its keyframe's.
        nq: how many of these are qpos.
        formulas: expressions over the initial values, and the indices that each one sets.
        perturbed: indices that a seed changes, by at most `scale`.
        scale: m, rad, m/s or rad/s.
        quaternions: where unit quaternions start.
    """

    state: Floats
    nq: int
    formulas: tuple[tuple[Expression, tuple[int, ...]], ...]
    perturbed: tuple[int, ...]
    scale: float
    quaternions: tuple[int, ...]

    @classmethod
    def of(cls, model: mujoco.MjModel, manifest: SceneManifest | None) -> "StartState":
        """Return how a model's start states are made.

        Raises:
            SceneError: the manifest names a keyframe or a coordinate that the model lacks.
        """
        coordinates, scale = perturbed_coordinates(model, manifest)
        offset = {"qpos": 0, "qvel": model.nq}
        return cls(
            state=_own_state(model, manifest.keyframe if manifest else None),
            nq=model.nq,
            formulas=tuple(_formulas(model, manifest)) if manifest else (),
            perturbed=tuple(offset[field] + index for field, index in coordinates),
            scale=scale,
            quaternions=quaternions(model),
        )


def start_states(
    start: StartState, runs: Sequence[tuple[Mapping[str, float], int]]
) -> tuple[Floats, Floats]:
    """Return qpos (n, nq) and qvel (n, nv) for each run's initial values and seed."""
    states = np.tile(start.state, (len(runs), 1))
    for row, (initial, seed) in zip(states, runs, strict=True):
        for formula, indices in start.formulas:
            row[list(indices)] = formula.evaluate(initial)
        if start.perturbed:
            offsets = np.random.default_rng(seed).uniform(-1, 1, len(start.perturbed))
            row[list(start.perturbed)] += start.scale * offsets
    if start.formulas or start.perturbed:
        _normalise(states, start)
    return states[:, : start.nq], states[:, start.nq :]


def quaternions(model: mujoco.MjModel) -> tuple[int, ...]:
    """Return the indices in qpos where a unit quaternion starts."""
    kinds: list[int] = model.jnt_type.tolist()
    return tuple(
        int(model.jnt_qposadr[joint]) + _ROTATIONS[kind]
        for joint, kind in enumerate(kinds)
        if kind in _ROTATIONS
    )


def _own_state(model: mujoco.MjModel, keyframe: str | None) -> Floats:
    data = mujoco.MjData(model)
    if keyframe is not None:
        index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, keyframe)
        if index < 0:
            raise SceneError(f"the manifest's keyframe '{keyframe}' is none of the model's")
        mujoco.mj_resetDataKeyframe(model, data, index)
    return np.concatenate([data.qpos, data.qvel])


def _formulas(
    model: mujoco.MjModel, manifest: SceneManifest
) -> list[tuple[Expression, tuple[int, ...]]]:
    offset = {"qpos": 0, "qvel": model.nq}
    formulas: list[tuple[Expression, tuple[int, ...]]] = []
    for name, entry in manifest.initial.items():
        for pattern, text in entry.sets.items():
            expression = Expression(text)
            unknown = set(expression.names) - set(manifest.initial)
            if unknown:
                raise SceneError(
                    f"initial value '{name}' sets {pattern} from unknown {', '.join(unknown)}; "
                    f"write one of {', '.join(manifest.initial)}"
                )
            indices = tuple(offset[each.field] + each.index for each in match(model, pattern))
            formulas.append((expression, indices))
    return formulas


def _normalise(states: Floats, start: StartState) -> None:
    for address in start.quaternions:
        part = states[:, address : address + 4]
        norm = np.linalg.norm(part, axis=1, keepdims=True)
        # Dividing a norm of exactly 1 would be harmless; of 1 + 1e-16, it would change bits.
        np.divide(part, norm, out=part, where=np.abs(norm - 1) > 1e-12)
