"""Start states: the model's own, what initial values set, and what a seed perturbs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.errors import SceneError, did_you_mean
from contactlab.plan import Expression, ExpressionError
from contactlab.scene.coordinates import match
from contactlab.schema import SceneManifest
from contactlab.trace import Floats

_PERTURBATION = 1e-4
_NUDGE = 1e-6
# Where a joint's quaternion starts within its part of qpos.
_ROTATIONS = {int(mujoco.mjtJoint.mjJNT_FREE): 3, int(mujoco.mjtJoint.mjJNT_BALL): 0}


class Starts(NamedTuple):
    """Start states of n runs.

    Attributes:
        qpos: (n, nq) configuration.
        qvel: (n, nv) velocity.
        ctrl: (n, nu) control, constant over the run.
        applied: (n, 6 nbody) force [N] and torque [N m] on each body, world frame, constant.
    """

    qpos: Floats
    qvel: Floats
    ctrl: Floats
    applied: Floats

    def pick(self, run: int) -> "Starts":
        """Return the start state of one run, n being 1."""
        return self.rows([run])

    def rows(self, runs: Sequence[int]) -> "Starts":
        """Return the start states of some runs."""
        return Starts(*(array[list(runs)] for array in self))

    @classmethod
    def joined(cls, starts: Sequence["Starts"]) -> "Starts":
        """Return the start states of several, one after the other."""
        return cls(*(np.concatenate(arrays) for arrays in zip(*starts, strict=True)))


@dataclass(frozen=True)
class StartState:
    """How the start states of one structure are made.

    Attributes:
        state: (nq + nv + nu + 6 nbody,) qpos, qvel, ctrl and xfrc_applied, the model's own or its
            keyframe's.
        ends: where each of the four ends.
        formulas: expressions over the initial values, and the indices that each one sets.
        perturbed: indices that a seed changes, by at most `scale`.
        scale: m, rad, m/s or rad/s.
        quaternions: where unit quaternions start.
    """

    state: Floats
    ends: tuple[int, ...]
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
        coordinates, scale = _perturbed_coordinates(model, manifest)
        offset = _offsets(model)
        return cls(
            state=_own_state(model, manifest.keyframe if manifest else None),
            ends=tuple(np.cumsum(list(_sizes(model).values())).tolist()),
            formulas=tuple(_formulas(model, manifest)) if manifest else (),
            perturbed=tuple(offset[field] + index for field, index in coordinates),
            scale=scale,
            quaternions=quaternions(model),
        )


def start_states(start: StartState, runs: Sequence[tuple[Mapping[str, float], int]]) -> Starts:
    """Return the start states for each run's initial values and seed."""
    states = np.tile(start.state, (len(runs), 1))
    for row, (initial, seed) in zip(states, runs, strict=True):
        for formula, indices in start.formulas:
            row[list(indices)] = _computed(formula, initial)
        if start.perturbed:
            offsets = np.random.default_rng(seed).uniform(-1, 1, len(start.perturbed))
            row[list(start.perturbed)] += start.scale * offsets
    if start.formulas or start.perturbed:
        _normalise(states, start)
    return Starts(*np.split(states, start.ends[:-1], axis=1))


def _computed(formula: Expression, initial: Mapping[str, float]) -> float:
    try:
        result = formula.evaluate(initial)
    except ExpressionError as error:
        raise SceneError(f"cannot compute '{formula.text}' for {dict(initial)}: {error}") from error
    if not isinstance(result, float):
        raise SceneError(f"'{formula.text}' is {result!r}, not a number")
    return result


def nudged_states(start: StartState, states: Starts, seeds: Sequence[int]) -> Starts:
    """Return start states a millionth of a metre or radian away; rotations stay as they are."""
    turning = {address + part for address in start.quaternions for part in range(4)}
    moving = [index for index in range(states.qpos.shape[1]) if index not in turning]
    qpos = states.qpos.copy()
    for row, seed in zip(qpos, seeds, strict=True):
        # A stream of its own: the seed's first one perturbs the start itself.
        row[moving] += _NUDGE * np.random.default_rng([seed, 1]).uniform(-1, 1, len(moving))
    return states._replace(qpos=qpos)


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
            known = [model.key(each).name for each in range(model.nkey)]
            raise SceneError(
                f"no keyframe '{keyframe}' in the model{did_you_mean(keyframe, known)}"
            )
        mujoco.mj_resetDataKeyframe(model, data, index)
    return np.concatenate([getattr(data, field).ravel() for field in _sizes(model)])


def _sizes(model: mujoco.MjModel) -> dict[str, int]:
    return {"qpos": model.nq, "qvel": model.nv, "ctrl": model.nu, "xfrc_applied": 6 * model.nbody}


def _offsets(model: mujoco.MjModel) -> dict[str, int]:
    sizes = _sizes(model)
    return dict(zip(sizes, [0, *np.cumsum(list(sizes.values()))[:-1].tolist()], strict=True))


def _formulas(
    model: mujoco.MjModel, manifest: SceneManifest
) -> list[tuple[Expression, tuple[int, ...]]]:
    offset = _offsets(model)
    formulas: list[tuple[Expression, tuple[int, ...]]] = []
    for name, entry in manifest.initial.items():
        for pattern, text in entry.sets.items():
            expression = _expression(text, f"initial value '{name}' sets {pattern}", manifest)
            indices = tuple(offset[each.field] + each.index for each in match(model, pattern))
            formulas.append((expression, indices))
    return formulas


def _expression(text: str, where: str, manifest: SceneManifest) -> Expression:
    try:
        expression = Expression(text)
    except ExpressionError as error:
        raise SceneError(f"{where} to '{text}': {error}") from error
    unknown = ", ".join(sorted(set(expression.names) - set(manifest.initial)))
    if unknown:
        known = ", ".join(manifest.initial)
        raise SceneError(f"{where} from unknown {unknown}; write one of {known}")
    return expression


def _normalise(states: Floats, start: StartState) -> None:
    for address in start.quaternions:
        part = states[:, address : address + 4]
        norm = np.linalg.norm(part, axis=1, keepdims=True)
        # Dividing a norm of exactly 1 would be harmless; of 1 + 1e-16, it would change bits.
        np.divide(part, norm, out=part, where=np.abs(norm - 1) > 1e-12)


def _perturbed_coordinates(
    model: mujoco.MjModel, manifest: SceneManifest | None
) -> tuple[list[tuple[str, int]], float]:
    """Return which numbers of the start state a seed changes, and by how much at most.

    Without a manifest: the horizontal place of free bodies, and every slide and hinge.
    """
    if manifest and manifest.perturb:
        patterns, scale = manifest.perturb.coordinates, manifest.perturb.scale
        found = [each for pattern in patterns for each in match(model, pattern)]
        return [(each.field, each.index) for each in found], scale
    if manifest:
        return [], 0.0
    return [("qpos", index) for index in _loose(model)], _PERTURBATION


def _loose(model: mujoco.MjModel) -> list[int]:
    indices: list[int] = []
    for joint in range(model.njnt):
        address, kind = int(model.jnt_qposadr[joint]), model.jnt_type[joint]
        if kind == mujoco.mjtJoint.mjJNT_FREE:
            indices += [address, address + 1]
        elif kind != mujoco.mjtJoint.mjJNT_BALL:
            indices.append(address)
    return indices
