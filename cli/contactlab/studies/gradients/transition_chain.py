"""The derivative of a run's end by MuJoCo's transition matrices, step by step."""

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.engines.engine import PreparedRuns
from contactlab.scene.initial_states import apply_inputs

_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
_FREE, _BALL = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)


def chain_transitions(
    runs: PreparedRuns, place: int, spread: float, epsilon: float = 1e-9
) -> float | None:
    """Return the derivative of a coordinate's end value, or None if MuJoCo has no such matrices.

    The runs are the run itself, and it with the parameter above and below, `spread` apart. A step
    from the run's own state has d x' = A d x + b d p: A is from mjd_transitionFD, and b the central
    difference of that step between both models and inputs, as MuJoCo has it for controls alone.
    `epsilon` is of the finite differences of a step; a larger one may cross the start or end of a
    contact.
    """
    model, *sides = runs.models
    row = tangent_place(model, place)
    if row is None:
        return None
    count = np.arange(runs.steps)
    inputs = [runs.starts.input_rows(run, model.opt.timestep, count) for run in range(3)]
    data, both = mujoco.MjData(model), [mujoco.MjData(side) for side in sides]
    for run, one in enumerate((data, *both)):
        one.qpos[:], one.qvel[:] = runs.starts.qpos[run], runs.starts.qvel[run]
        one.act[:] = runs.starts.act[run]
    change = _tangent_difference(model, *both) / spread
    binaries: list[bytes] = []
    for side in sides:
        buffer = np.empty(mujoco.mj_sizeModel(side), np.uint8)
        mujoco.mj_saveModel(side, None, buffer)
        binaries.append(buffer.tobytes())
    steady = binaries[0] == binaries[1] and np.array_equal(inputs[1], inputs[2])
    size = 2 * model.nv + model.na
    matrix, state = np.zeros((size, size)), np.zeros(mujoco.mj_stateSize(model, _STATE))
    try:
        for step in count:
            apply_inputs(model, data, inputs[0][step])
            mujoco.mjd_transitionFD(model, data, epsilon, True, matrix, None, None, None)
            change = matrix @ change
            if not steady:
                mujoco.mj_getState(model, data, state, _STATE)
                for side, other, driven in zip(sides, both, inputs[1:], strict=True):
                    mujoco.mj_setState(side, other, state, _STATE)
                    apply_inputs(side, other, driven[step])
                    mujoco.mj_step(side, other)
                change += _tangent_difference(model, *both) / spread
            mujoco.mj_step(model, data)
    except mujoco.FatalError:
        return None
    return float(change[row]) if np.isfinite(change[row]) else None


def tangent_place(model: mujoco.MjModel, place: int) -> int | None:
    """Return the index of a coordinate in the tangent space of a state; None for a quaternion."""
    if place >= model.nq:
        return place - model.nq + model.nv
    joint = int(np.searchsorted(model.jnt_qposadr, place, side="right")) - 1
    offset = place - int(model.jnt_qposadr[joint])
    kind = int(model.jnt_type[joint])
    translations = 3  # translational coordinates of a free joint
    if kind == _BALL or (kind == _FREE and offset >= translations):
        return None
    return int(model.jnt_dofadr[joint]) + offset


def _tangent_difference(model: mujoco.MjModel, up: mujoco.MjData, down: mujoco.MjData) -> Floats:
    """Return (2 nv + na) the difference of two states in the tangent space."""
    positions = np.zeros(model.nv)
    mujoco.mj_differentiatePos(model, positions, 1.0, down.qpos, up.qpos)
    return np.concatenate([positions, up.qvel - down.qvel, up.act - down.act])
