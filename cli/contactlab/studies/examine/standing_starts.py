"""Finds a start that a driven robot stands in, if it falls from its keyframe at once.

A fall alone may be intended. But if the robot stands as soon as one part of its keyframe is that of
its model, this part was not meant: the turn of its root, or the joints that the keyframe's own
controls hold elsewhere.
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.budget.windows import add_simulated_steps
from contactlab.contact.trace_arrays import Floats
from contactlab.judge.wording import plural
from contactlab.rendering.amounts import format_amount
from contactlab.scene.closed_start import moving_extent
from contactlab.scene.floating_bases import (
    count_own_joints,
    find_driven_joints,
    list_unsupported_roots,
)
from contactlab.scene.model_names import name_of
from contactlab.scene.part_bodies import AT_JOINT
from contactlab.schema.examination import Cause, Fact

_FREE = int(mujoco.mjtJoint.mjJNT_FREE)
_SCALAR = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))
_BAD_STATES = [
    int(getattr(mujoco.mjtWarning, f"mjWARN_BADQ{name}")) for name in ("POS", "VEL", "ACC")
]
_LONGEST = 2.0  # s; by then, a robot that does not stand has fallen
_FIXED_GAIN, _AFFINE_BIAS = int(mujoco.mjtGain.mjGAIN_FIXED), int(mujoco.mjtBias.mjBIAS_AFFINE)


class StandingPose(NamedTuple):
    """The configuration (nq,) of another start, and its difference from the keyframe's."""

    positions: Floats
    difference: str


class HeldPosition(NamedTuple):
    """A position servo, its joint, and the position that its control holds it at [rad, m].

    The target is that of the control, which may lie beyond the joint's range.
    """

    actuator: int
    joint: int
    position: float
    target: float


def list_standing_poses(motion: Motion) -> Iterator[StandingPose]:
    """Yield poses near that of a keyframe: joints as its controls hold them, then a root upright.

    Each differs from the start of the motion.
    """
    model, data = motion.model, begin_motion(motion)
    held = data.qpos.copy()
    for _, joint, position, _ in list_held_positions(model, data):
        held[model.jnt_qposadr[joint]] = position
    if not np.array_equal(held, data.qpos):
        yield StandingPose(held, "its joints where its controls hold them")
    turned = data.qpos.copy()
    for joint in _find_driven_roots(model):
        place = int(model.jnt_qposadr[joint]) + 3
        turned[place : place + 4] = model.qpos0[place : place + 4]
    if not np.allclose(turned, data.qpos):
        yield StandingPose(turned, "its root turned as in the reference pose")


def list_falls(motion: Motion, causes: Sequence[Cause]) -> Iterator[Fact]:
    """Yield the fact that a robot falls, unless its file or its start is a known cause."""
    is_known = any(cause.stage in ("file", "start") for cause in causes)
    fall = 0.0 if is_known else find_fall(motion)
    if fall:
        root = name_of(motion.model, "body", int(_find_roots(motion.model)[0]))
        yield Fact(
            kind="fall",
            place=root,
            value=fall,
            unit="m",
            sentence=f"{root} falls by {format_amount(fall, 'mm')} within {_LONGEST:g} s: the "
            "drive of this task does not hold the robot up; --drive takes its controller",
        )


def list_free_falls(model: mujoco.MjModel) -> Iterator[Fact]:
    """Yield the fact that a robot without actuators falls freely, since nothing is below it."""
    for root in list_unsupported_roots(model):
        joints = count_own_joints(model, root)
        if joints and not find_driven_joints(model, root):
            name = name_of(model, "body", root)
            yield Fact(
                kind="fall",
                place=name,
                value=joints,
                unit="1",
                sentence=f"nothing is below the floating base {name}, and no actuator drives its "
                f"{plural(joints, 'joint')}: it falls freely, and only contacts of its own links "
                "are judged; examine the scene that includes it",
            )
            return


def find_fall(motion: Motion, positions: Floats | None = None) -> float:
    """Return how far a driven floating robot falls [m]; 0 if it stands, or none floats.

    It falls if its root tips by more than 45 degrees, or sinks by more than a quarter of the
    robot's extent.

    Args:
        motion: from the keyframe; its controls are those of the first seed.
        positions: another configuration (nq,) to begin in.
    """
    model, data = motion.model, begin_motion(motion)
    roots = _find_roots(model)
    weight = float(np.linalg.norm(model.opt.gravity))
    if not roots or not weight:
        return 0.0
    if positions is not None:
        data.qpos[:] = positions
        mujoco.mj_forward(model, data)
    up, extent = -np.array(model.opt.gravity) / weight, moving_extent(model, data)
    before, turns = data.xpos[roots] @ up, data.xmat[roots].reshape(-1, 3, 3).copy()
    for _ in step_first_seed(motion, data, _LONGEST):
        pass
    lost = before - data.xpos[roots] @ up
    now = data.xmat[roots].reshape(-1, 3, 3)
    # The world's vertical, in the frame of the root, before and after.
    leans = np.einsum("nij,i,nkj,k->n", turns, up, now, up)
    tips, sinks = leans < np.sqrt(0.5), lost > extent / 4
    return float(np.abs(lost[tips | sinks]).max(initial=0.0))


def step_first_seed(
    motion: Motion, data: mujoco.MjData, seconds: float = math.inf
) -> Iterator[int]:
    """Make the steps of a motion's first seed, and yield the number of each after it.

    They end where the engine gives up: later states mean nothing, and their steps take long.
    """
    model, rows = motion.model, motion.inputs[0]
    for step in range(math.ceil(min(len(rows), seconds / model.opt.timestep))):
        if rows.shape[1]:
            mujoco.mj_setState(model, data, rows[step], motion.spec)
        mujoco.mj_step(model, data)
        add_simulated_steps(model, 1)
        if data.warning.number[_BAD_STATES].any():
            return
        yield step


def begin_motion(motion: Motion) -> mujoco.MjData:
    """Return the data of a motion's first start with its first inputs, forwarded."""
    data = mujoco.MjData(motion.model)
    mujoco.mj_setState(motion.model, data, motion.starts[0], INTEGRATION)
    if motion.inputs.shape[-1]:
        mujoco.mj_setState(motion.model, data, motion.inputs[0, 0], motion.spec)
    mujoco.mj_forward(motion.model, data)
    return data


def list_held_positions(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[HeldPosition]:
    """Yield the position servos of joints, and where their controls hold these in their ranges."""
    servos = np.isin(model.actuator_trntype, AT_JOINT) & (model.actuator_biasprm[:, 1] < 0)
    servos &= (model.actuator_gaintype == _FIXED_GAIN) & (model.actuator_biastype == _AFFINE_BIAS)
    for actuator in np.flatnonzero(servos).tolist():
        joint = int(model.actuator_trnid[actuator, 0])
        gain, bias = model.actuator_gainprm[actuator, 0], model.actuator_biasprm[actuator]
        gear = float(model.actuator_gear[actuator, 0])
        if model.jnt_type[joint] not in _SCALAR or not gear:
            continue
        target = position = float(-(gain * data.ctrl[actuator] + bias[0]) / (bias[1] * gear))
        if model.jnt_limited[joint]:
            position = float(np.clip(position, *model.jnt_range[joint]))
        yield HeldPosition(actuator, joint, position, target)


def _find_roots(model: mujoco.MjModel) -> list[int]:
    return [int(model.jnt_bodyid[joint]) for joint in _find_driven_roots(model)]


def _find_driven_roots(model: mujoco.MjModel) -> NDArray[np.intp]:
    # Free joints of robots that have an actuator at a joint.
    at_joint = np.isin(model.actuator_trntype, AT_JOINT)
    joints = np.asarray(model.actuator_trnid)[at_joint, 0]
    driven = model.body_rootid[model.jnt_bodyid[joints]]
    free = np.flatnonzero(model.jnt_type == _FREE)
    return free[np.isin(model.body_rootid[model.jnt_bodyid[free]], driven)]
