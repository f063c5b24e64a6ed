"""Joints of a model: names of their coordinates, norms on their configurations, actuated limbs.

Names of coordinates are such as `ball.z`, `box.vx`, `hinge`, `hinge.v`, `box.fx`.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from contactlab.contact.trace_setup import Joints
from contactlab.errors import SceneError, did_you_mean
from contactlab.scene.addresses import is_address, matching

_FREE_POSITION = ("x", "y", "z", "qw", "qx", "qy", "qz")
_FREE_VELOCITY = ("vx", "vy", "vz", "wx", "wy", "wz")
_FORCE = ("fx", "fy", "fz", "tx", "ty", "tz")
_BALL_POSITION = ("qw", "qx", "qy", "qz")
_BALL_VELOCITY = ("wx", "wy", "wz")


@dataclass(frozen=True)
class StateCoordinate:
    """One number of the state: a field and an index in it."""

    field: Literal["qpos", "qvel", "ctrl", "xfrc_applied", "mocap"]
    index: int


def coordinates(model: mujoco.MjModel) -> dict[str, StateCoordinate]:
    """Return every coordinate of a model by name.

    Slides and hinges are JOINT [m or rad] and JOINT.v; free and ball joints have a name for each
    component: positions and linear velocities in the world frame, angular velocities in the body
    frame. A joint without a name has its body's as well. BODY.fx to .tz are a constant external
    force [N] and torque [N m] at the body's centre of mass, world frame; ACTUATOR.ctrl is a
    constant control.
    """
    return dict([*_inputs(model), *_named(model)])


def mocap_coordinates(model: mujoco.MjModel) -> dict[str, StateCoordinate]:
    """Return BODY.x to .z [m] and .qw to .qz of every mocap body, as MuJoCo orders poses of all."""
    found: dict[str, StateCoordinate] = {}
    for body in np.flatnonzero(np.asarray(model.body_mocapid) >= 0).tolist():
        name, place = model.body(body).name, int(model.body_mocapid[body])
        starts = (*range(3 * place, 3 * place + 3), *range(4 * place, 4 * place + 4))
        for offset, (part, start) in enumerate(zip(_dotted(_FREE_POSITION), starts, strict=True)):
            index = start if offset < 3 else 3 * model.nmocap + start
            found[name + part] = StateCoordinate("mocap", index)
    return found


def match_coordinates(
    model: mujoco.MjModel, pattern: str, *, mocap: bool = False
) -> list[StateCoordinate]:
    """Return the coordinates whose name matches a pattern such as `box*.x`.

    Args:
        model: the model.
        pattern: of names.
        mocap: whether poses of mocap bodies are among them.

    Raises:
        SceneError: nothing matches.
    """
    known = coordinates(model) | (mocap_coordinates(model) if mocap else {})
    found = dict.fromkeys(known[name] for name in matching(known, pattern))
    if not found:
        raise SceneError(f"the model has no coordinate '{pattern}'{did_you_mean(pattern, known)}")
    return list(found)


def _inputs(model: mujoco.MjModel) -> Iterator[tuple[str, StateCoordinate]]:
    for body in range(1, model.nbody):
        for offset, part in enumerate(_dotted(_FORCE)):
            yield model.body(body).name + part, StateCoordinate("xfrc_applied", 6 * body + offset)
    for actuator in range(model.nu):
        yield f"{model.actuator(actuator).name}.ctrl", StateCoordinate("ctrl", actuator)


def _named(model: mujoco.MjModel) -> Iterator[tuple[str, StateCoordinate]]:
    for index in range(model.njnt):
        joint = model.joint(index)
        positions, velocities = _components(int(joint.type[0]))
        for name in _names(model, index):
            for offset, part in enumerate(positions):
                yield name + part, StateCoordinate("qpos", int(joint.qposadr[0]) + offset)
            for offset, part in enumerate(velocities):
                yield name + part, StateCoordinate("qvel", int(joint.dofadr[0]) + offset)


def _names(model: mujoco.MjModel, joint: int) -> list[str]:
    """Return what a joint is called: its name; or its body's, and its address."""
    name = model.joint(joint).name
    return [model.body(model.jnt_bodyid[joint]).name, name] if is_address(name) else [name]


def _components(joint_type: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    if joint_type == mujoco.mjtJoint.mjJNT_FREE:
        return _dotted(_FREE_POSITION), _dotted(_FREE_VELOCITY)
    if joint_type == mujoco.mjtJoint.mjJNT_BALL:
        return _dotted(_BALL_POSITION), _dotted(_BALL_VELOCITY)
    return ("",), (".v",)


def _dotted(parts: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f".{part}" for part in parts)


_JOINT = mujoco.mjtJoint


def joints_of(model: mujoco.MjModel) -> Joints:
    """Return the joints of a model, with the lengths that MuJoCo gives their degrees of freedom."""
    kinds = np.asarray(model.jnt_type)
    places, dofs = np.asarray(model.jnt_qposadr), np.asarray(model.jnt_dofadr)
    scalar = (kinds == _JOINT.mjJNT_SLIDE) | (kinds == _JOINT.mjJNT_HINGE)
    free, ball = kinds == _JOINT.mjJNT_FREE, kinds == _JOINT.mjJNT_BALL
    turning = [*(dofs[free] + 3), *dofs[ball]]
    return Joints(
        scalars=tuple(places[scalar].tolist()),
        lengths=np.array(model.dof_length[dofs[scalar]]),
        points=tuple(places[free].tolist()),
        rotations=(*(places[free] + 3).tolist(), *places[ball].tolist()),
        reaches=np.array(model.dof_length[turning]) if turning else np.empty(0),
    )


def actuated_limbs(model: mujoco.MjModel) -> dict[str, int]:
    """Return how many limbs with actuated joints each body on a free joint has, if any.

    A limb is a child of the free body with all of its descendants.
    """
    driven = {int(model.jnt_bodyid[joint]) for joint in _driven_joints(model)}
    limbs: dict[int, set[int]] = {}
    for body in driven:
        chain = [body]
        while model.body_parentid[chain[-1]]:
            chain.append(int(model.body_parentid[chain[-1]]))
        if len(chain) > 1 and _is_free(model, chain[-1]):
            limbs.setdefault(chain[-1], set()).add(chain[-2])
    return {model.body(root).name: len(each) for root, each in limbs.items()}


def _is_free(model: mujoco.MjModel, body: int) -> bool:
    joint = int(model.body_jntadr[body])
    return joint >= 0 and int(model.jnt_type[joint]) == mujoco.mjtJoint.mjJNT_FREE


def _driven_joints(model: mujoco.MjModel) -> Iterator[int]:
    kinds = mujoco.mjtTrn
    for actuator in range(model.nu):
        kind, item = int(model.actuator_trntype[actuator]), int(model.actuator_trnid[actuator, 0])
        if kind in (kinds.mjTRN_JOINT, kinds.mjTRN_JOINTINPARENT):
            yield item
        elif kind == kinds.mjTRN_TENDON:
            yield from _joints_of(model, item)


def _joints_of(model: mujoco.MjModel, tendon: int) -> Iterator[int]:
    """Yield the joints that a fixed tendon couples; a spatial tendon names none."""
    start = int(model.tendon_adr[tendon])
    wraps = np.arange(start, start + int(model.tendon_num[tendon]))
    for wrap in wraps:
        if int(model.wrap_type[wrap]) == mujoco.mjtWrap.mjWRAP_JOINT:
            yield int(model.wrap_objid[wrap])
