"""Names for the numbers of a start state: `ball.z`, `box.vx`, `hinge`, `hinge.v`, `box.fx`."""

import fnmatch
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import mujoco

from contactlab.errors import SceneError, did_you_mean

_FREE_POSITION = ("x", "y", "z", "qw", "qx", "qy", "qz")
_FREE_VELOCITY = ("vx", "vy", "vz", "wx", "wy", "wz")
_FORCE = ("fx", "fy", "fz", "tx", "ty", "tz")
_BALL_POSITION = ("qw", "qx", "qy", "qz")
_BALL_VELOCITY = ("wx", "wy", "wz")


@dataclass(frozen=True)
class Coordinate:
    """One number of the state: a field and an index in it."""

    field: Literal["qpos", "qvel", "ctrl", "xfrc_applied"]
    index: int


def coordinates(model: mujoco.MjModel) -> dict[str, Coordinate]:
    """Return every coordinate of a model by name.

    Slides and hinges are JOINT (m or rad) and JOINT.v; free and ball joints have a name for each
    component. Free joints rotate in the body's frame and move in the world's. A joint without a
    name takes its body's. BODY.fx to .tz are a constant external force [N] and torque [N m] at the
    body's centre of mass, in the world's frame; ACTUATOR.ctrl is a constant control.
    """
    return dict([*_inputs(model), *_named(model)])


def match(model: mujoco.MjModel, pattern: str) -> list[Coordinate]:
    """Return the coordinates whose name matches a pattern such as `box*.x`.

    Raises:
        SceneError: nothing matches.
    """
    known = coordinates(model)
    found = [known[name] for name in known if fnmatch.fnmatchcase(name, pattern)]
    if not found:
        raise SceneError(f"no coordinate '{pattern}' in the model{did_you_mean(pattern, known)}")
    return found


def _inputs(model: mujoco.MjModel) -> Iterator[tuple[str, Coordinate]]:
    for body in range(1, model.nbody):
        for offset, part in enumerate(_dotted(_FORCE)):
            yield model.body(body).name + part, Coordinate("xfrc_applied", 6 * body + offset)
    for actuator in range(model.nu):
        yield f"{model.actuator(actuator).name}.ctrl", Coordinate("ctrl", actuator)


def _named(model: mujoco.MjModel) -> Iterator[tuple[str, Coordinate]]:
    for index in range(model.njnt):
        joint = model.joint(index)
        name = joint.name or model.body(joint.bodyid[0]).name
        positions, velocities = _components(int(joint.type[0]))
        for offset, part in enumerate(positions):
            yield name + part, Coordinate("qpos", int(joint.qposadr[0]) + offset)
        for offset, part in enumerate(velocities):
            yield name + part, Coordinate("qvel", int(joint.dofadr[0]) + offset)


def _components(joint_type: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    if joint_type == mujoco.mjtJoint.mjJNT_FREE:
        return _dotted(_FREE_POSITION), _dotted(_FREE_VELOCITY)
    if joint_type == mujoco.mjtJoint.mjJNT_BALL:
        return _dotted(_BALL_POSITION), _dotted(_BALL_VELOCITY)
    return ("",), (".v",)


def _dotted(parts: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f".{part}" for part in parts)
