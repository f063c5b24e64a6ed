"""Names in a model: addresses of unnamed objects, and coordinates of its state and inputs.

An object without a name has an address with its id in MuJoCo, such as `actuator[3]`, `joint[2]` or
`key[0]`. In a compiled scene these addresses are the names, so that all code finds and prints each
object by the same word. Coordinates have names such as `ball.z`, `box.vx`, `hinge`, `hinge.v`,
`box.fx`.
"""

import fnmatch
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal

import mujoco
import numpy as np

from contactlab.errors import SceneError, did_you_mean
from contactlab.printable import Replacer

OBJECT_LISTS = {
    "body": "bodies",
    "joint": "joints",
    "geom": "geoms",
    "pair": "pairs",
    "equality": "equalities",
    "tendon": "tendons",
    "actuator": "actuators",
    "key": "keys",
}
"""MuJoCo's name of one object of a kind, and of the list of all of them in a specification."""
_ADDRESS = re.compile(rf"({'|'.join(OBJECT_LISTS)})\[\d+\]_*")
_GEOM_ADDRESS = re.compile(r"geom\[\d+\]_*")
_OLD_ADDRESS = re.compile(r"geom(\d+)")  # address of a geom before version 0.3
# A bracket before a number or a wildcard belongs to an address.
_ADDRESS_BRACKET = re.compile(r"\[(?=[\d*?]+\])")


def is_address(name: str) -> bool:
    """Return whether a name in a compiled scene is an address, which replaces a missing name."""
    return _ADDRESS.fullmatch(name) is not None


def name_by_address(spec: mujoco.MjSpec) -> None:
    """Give unnamed objects of a specification their address as name.

    Raises a ValueError if it is invalid.
    """
    kinds = {kind: list(getattr(spec, plural)) for kind, plural in OBJECT_LISTS.items()}
    if all(element.name for elements in kinds.values() for element in elements):
        return
    # The id of each element in the compiled specification; -1 for removed elements.
    if not (spec.compiler.fusestatic or spec.compiler.discardvisual):
        ids = {kind: range(len(elements)) for kind, elements in kinds.items()}
    else:
        trial = spec.copy()
        names: dict[str, list[str]] = {}
        for kind, plural in OBJECT_LISTS.items():
            elements: list[Any] = list(getattr(trial, plural))
            names[kind] = [element.name or f"?{place}" for place, element in enumerate(elements)]
            for element, name in zip(elements, names[kind], strict=True):
                element.name = name
        model = trial.compile()
        ids = {
            kind: [_object_id(model, kind, name) for name in members]
            for kind, members in names.items()
        }
    for kind, elements in kinds.items():
        used_names = {element.name for element in elements}
        for element, index in zip(elements, ids[kind], strict=True):
            if not element.name and index >= 0:
                address = f"{kind}[{index}]"
                while address in used_names:
                    address += "_"
                element.name = address


def _object_id(model: mujoco.MjModel, kind: str, name: str) -> int:
    return mujoco.mj_name2id(model, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), name)


def find_id(model: mujoco.MjModel, kind: str, name: str) -> int:
    """Return the id of an object of a compiled scene by name or address; -1 if there is none."""
    object_id = _object_id(model, kind, name)
    old = _OLD_ADDRESS.fullmatch(name) if kind == "geom" and object_id < 0 else None
    return _object_id(model, kind, f"geom[{old[1]}]") if old else object_id


def name_of(model: mujoco.MjModel, kind: str, index: int) -> str:
    """Return the name of an object, or its address if it has no name, as in a binary model."""
    return getattr(model, kind)(index).name or f"{kind}[{index}]"


def geom_names_by_address(model: mujoco.MjModel) -> dict[str, str]:
    """Return the printed names of unnamed geoms by address: their body's name.

    If the body has several geoms, the address follows the name.
    """
    bodies: list[int] = model.geom_bodyid.tolist()
    count = Counter(bodies)
    names = ((name_of(model, "geom", geom), body) for geom, body in enumerate(bodies))
    return {
        name: name_of(model, "body", body) + (f" {name}" if count[body] > 1 else "")
        for name, body in names
        if is_address(name)
    }


def geom_name_replacer(model: mujoco.MjModel) -> Replacer:
    """Return the function that replaces addresses of geoms in a text, such as a pair's name."""
    words = geom_names_by_address(model)
    return lambda text: _GEOM_ADDRESS.sub(lambda match: words.get(match[0], match[0]), text)


def printed_geom_name(model: mujoco.MjModel, geom: int) -> str:
    """Return the printed name of a geom: its name, or otherwise its body's."""
    name = name_of(model, "geom", geom)
    return geom_names_by_address(model).get(name, name)


def require_id(model: mujoco.MjModel, kind: Literal["body", "geom"], name: str) -> int:
    """Return the id of a body or geom. Raises a SceneError if the name does not exist."""
    index = find_id(model, kind, name)
    if index < 0:
        known = [name_of(model, kind, member) for member in range(getattr(model, f"n{kind}"))]
        SceneError.unless_known(name, known, f"no {kind} '{name}' in the model")
        return known.index(name)
    return index


def match_names(names: Iterable[str], pattern: str) -> list[str]:
    """Return the names that equal or match a pattern such as `box*.x`, `leg[12]`, `actuator[*]`."""
    known = list(names)
    if pattern in known:
        return [pattern]
    literal = _ADDRESS_BRACKET.sub("[[]", pattern)
    return [
        name
        for name in known
        if fnmatch.fnmatchcase(name, pattern) or fnmatch.fnmatchcase(name, literal)
    ]


STATE_PARTS = ("qpos", "qvel", "act", "ctrl", "applied", "mocap")
"""The parts of a state, followed by the parts of its inputs, as in `InitialStates`."""

_POSE_SUFFIXES = (".x", ".y", ".z", ".qw", ".qx", ".qy", ".qz")
_VELOCITY_SUFFIXES = (".vx", ".vy", ".vz", ".wx", ".wy", ".wz")
_FORCE_SUFFIXES = (".fx", ".fy", ".fz", ".tx", ".ty", ".tz")
_JOINT_SUFFIXES = {
    int(mujoco.mjtJoint.mjJNT_FREE): (_POSE_SUFFIXES, _VELOCITY_SUFFIXES),
    int(mujoco.mjtJoint.mjJNT_BALL): (_POSE_SUFFIXES[3:], _VELOCITY_SUFFIXES[3:]),
}


def part_starts(model: mujoco.MjModel) -> dict[str, int]:
    """Return the index of each part in a row with one run's data of `InitialStates`."""
    sizes = (model.nq, model.nv, model.na, model.nu, 6 * model.nbody)
    return dict(zip(STATE_PARTS, np.cumsum([0, *sizes]).tolist(), strict=True))


def coordinate_indices(model: mujoco.MjModel) -> dict[str, int]:
    """Return the index of every coordinate of a model in such a row, by name.

    Slides and hinges are JOINT [m or rad] and JOINT.v; free and ball joints have a name for each
    component: positions and linear velocities in the world frame, angular velocities in the body
    frame. A joint without a name also has its body's name. BODY.fx to .tz are a constant external
    force [N] and torque [N m] at the body's center of mass, world frame; ACTUATOR.ctrl is a
    constant control.
    """
    starts, indices = part_starts(model), dict[str, int]()
    for body in range(1, model.nbody):
        for offset, part in enumerate(_FORCE_SUFFIXES):
            indices[name_of(model, "body", body) + part] = starts["applied"] + 6 * body + offset
    for actuator in range(model.nu):
        indices[f"{name_of(model, 'actuator', actuator)}.ctrl"] = starts["ctrl"] + actuator
    return indices | dict(_joint_coordinates(model, starts))


def mocap_coordinates(model: mujoco.MjModel) -> dict[str, int]:
    """Return BODY.x to .z [m] and .qw to .qz of every mocap body, in MuJoCo's order of poses."""
    indices, first = dict[str, int](), part_starts(model)["mocap"]
    for body in np.flatnonzero(np.asarray(model.body_mocapid) >= 0).tolist():
        name, place = name_of(model, "body", body), int(model.body_mocapid[body])
        starts = (*range(3 * place, 3 * place + 3), *range(4 * place, 4 * place + 4))
        for offset, (part, start) in enumerate(zip(_POSE_SUFFIXES, starts, strict=True)):
            indices[name + part] = first + start + (3 * model.nmocap if offset >= 3 else 0)
    return indices


def start_coordinates(model: mujoco.MjModel) -> dict[str, int]:
    """Return the index of every coordinate and velocity of the joints in a run's start, by name."""
    return dict(_joint_coordinates(model, part_starts(model)))


def coordinate_unit(model: mujoco.MjModel, index: int) -> str:
    """Return the unit of a number of (qpos, qvel), by its index; 1 for parts of quaternions."""
    speed = index >= model.nq
    starts = model.jnt_dofadr if speed else model.jnt_qposadr
    joint = int(np.searchsorted(starts, index - model.nq * speed, side="right")) - 1
    offset = index - model.nq * speed - int(starts[joint])
    match int(model.jnt_type[joint]):
        case mujoco.mjtJoint.mjJNT_FREE:
            unit = "m" if offset < 3 else "rad" if speed else "1"
        case mujoco.mjtJoint.mjJNT_BALL:
            unit = "rad" if speed else "1"
        case mujoco.mjtJoint.mjJNT_SLIDE:
            unit = "m"
        case _:
            unit = "rad"
    return f"{unit}/s" if speed else unit


def free_body_heights(model: mujoco.MjModel) -> list[int]:
    """Return the indices of the z coordinates of free joints in qpos."""
    free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    return (model.jnt_qposadr[free] + 2).tolist()


def match_coordinates(model: mujoco.MjModel, pattern: str, *, mocap: bool = False) -> list[int]:
    """Return the coordinates, and optionally mocap poses, that match a pattern such as `box*.x`.

    Raises a SceneError if nothing matches.
    """
    known = coordinate_indices(model) | (mocap_coordinates(model) if mocap else {})
    matches = dict.fromkeys(known[name] for name in match_names(known, pattern))
    if not matches:
        raise SceneError(f"the model has no coordinate '{pattern}'{did_you_mean(pattern, known)}")
    return list(matches)


def input_names(model: mujoco.MjModel, places: Sequence[int] = ()) -> list[str]:
    """Return the names of some inputs by index, or of all controls, without `.ctrl`."""
    first = part_starts(model)["ctrl"]
    named = {place - first: name for name, place in coordinate_indices(model).items()}
    names = (named[place] for place in places or range(model.nu))
    return [name.removesuffix(".ctrl") for name in names]


def _joint_coordinates(
    model: mujoco.MjModel, starts: Mapping[str, int]
) -> Iterator[tuple[str, int]]:
    for index in range(model.njnt):
        joint, own = model.joint(index), name_of(model, "joint", index)
        positions, velocities = _JOINT_SUFFIXES.get(int(joint.type[0]), (("",), (".v",)))
        bodies = [name_of(model, "body", model.jnt_bodyid[index])] if is_address(own) else []
        for name in (*bodies, own):
            for offset, part in enumerate(positions):
                yield name + part, int(joint.qposadr[0]) + offset
            for offset, part in enumerate(velocities):
                yield name + part, starts["qvel"] + int(joint.dofadr[0]) + offset
