"""Start states: the model's own, what initial values set, and what a seed perturbs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from contactlab.contact import Floats
from contactlab.expression import Expression
from contactlab.scene.control import Programme, drawn, read_programmes
from contactlab.scene.coordinates import match
from contactlab.scene.formula import computed, read_formula
from contactlab.scene.keyframes import start_data
from contactlab.scene.starts import Starts
from contactlab.schema import SceneManifest

_PERTURBATION = 1e-4
_NUDGE = 1e-6
# Where a joint's quaternion starts within its part of qpos.
_ROTATIONS = {int(mujoco.mjtJoint.mjJNT_FREE): 3, int(mujoco.mjtJoint.mjJNT_BALL): 0}


@dataclass(frozen=True)
class StartState:
    """How the start states of one structure are made.

    Attributes:
        state: qpos, qvel, ctrl, xfrc_applied and act, the model's own or a keyframe's.
        ends: where each of them ends.
        formulas: expressions over the initial values, and the indices that each one sets.
        programmes: what inputs do over time.
        perturbed: indices that a seed changes, by at most `scale`.
        scale: m, rad, m/s or rad/s.
        quaternions: where unit quaternions start.
    """

    state: Floats
    ends: tuple[int, ...]
    formulas: tuple[tuple[Expression, tuple[int, ...]], ...]
    programmes: tuple[Programme, ...]
    perturbed: tuple[int, ...]
    scale: float
    quaternions: tuple[int, ...]

    @classmethod
    def of(
        cls, model: mujoco.MjModel, manifest: SceneManifest | None, keyframe: str
    ) -> "StartState":
        """Return how a model's start states are made, from a keyframe or `OWN_START`.

        Raises:
            SceneError: the manifest names a coordinate that the model lacks.
        """
        coordinates, scale = _perturbed_coordinates(model, manifest)
        offset = _offsets(model)
        return cls(
            state=_state(model, keyframe),
            ends=tuple(np.cumsum(list(_sizes(model).values())).tolist()),
            formulas=tuple(_formulas(model, manifest)) if manifest else (),
            programmes=read_programmes(model, manifest),
            perturbed=tuple(offset[field] + index for field, index in coordinates),
            scale=scale,
            quaternions=quaternions(model),
        )


def start_states(start: StartState, runs: Sequence[tuple[Mapping[str, float], int]]) -> Starts:
    """Return the start states for each run's initial values and seed."""
    states = np.tile(start.state, (len(runs), 1))
    for row, (initial, seed) in zip(states, runs, strict=True):
        for formula, indices in start.formulas:
            row[list(indices)] = computed(formula, initial)
        if start.perturbed:
            offsets = np.random.default_rng(seed).uniform(-1, 1, len(start.perturbed))
            row[list(start.perturbed)] += start.scale * offsets
    if start.formulas or start.perturbed:
        _normalise(states, start)
    qpos, qvel, ctrl, applied, act = np.split(states, start.ends[:-1], axis=1)
    lines = drawn(start.programmes, [initial for initial, _ in runs])
    return _driven(Starts(qpos, qvel, ctrl, applied, *lines, act))


def _driven(starts: Starts) -> Starts:
    """Return starts whose driven inputs are what they are at the start."""
    if not starts.driven.size:
        return starts
    controls = starts.ctrl.shape[1]
    first = np.zeros(1, np.intp)
    inputs = np.concatenate([starts.inputs(run, 0.0, first) for run in range(len(starts.ctrl))])
    return starts._replace(ctrl=inputs[:, :controls], applied=inputs[:, controls:])


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


def _state(model: mujoco.MjModel, keyframe: str) -> Floats:
    data = start_data(model, keyframe)
    return np.concatenate([getattr(data, field).ravel() for field in _sizes(model)])


def _sizes(model: mujoco.MjModel) -> dict[str, int]:
    return {
        "qpos": model.nq,
        "qvel": model.nv,
        "ctrl": model.nu,
        "xfrc_applied": 6 * model.nbody,
        "act": model.na,
    }


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
            expression = read_formula(text, f"initial value '{name}' sets {pattern}", manifest)
            indices = tuple(offset[each.field] + each.index for each in match(model, pattern))
            formulas.append((expression, indices))
    return formulas


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
