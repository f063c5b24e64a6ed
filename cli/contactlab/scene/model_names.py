"""Names of a model: addresses of what has none, and coordinates of its state and inputs.

What has no name has an address with its id in MuJoCo, as `actuator[3]`, `joint[2]` or `key[0]`.
A compiled scene has them as names, so that whatever finds or prints a name has one word for each
thing. Names of coordinates are such as `ball.z`, `box.vx`, `hinge`, `hinge.v`, `box.fx`.
"""

import fnmatch
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal

import mujoco
import numpy as np

from contactlab.errors import SceneError, did_you_mean
from contactlab.printable import Told

KINDS = {
    "body": "bodies",
    "joint": "joints",
    "geom": "geoms",
    "pair": "pairs",
    "equality": "equalities",
    "tendon": "tendons",
    "actuator": "actuators",
    "key": "keys",
}
"""As MuJoCo calls one of a kind, and all of them in a specification."""
_ADDRESS = re.compile(rf"({'|'.join(KINDS)})\[\d+\]_*")
_GEOM_ADDRESS = re.compile(r"geom\[\d+\]_*")
_OLD_ADDRESS = re.compile(r"geom(\d+)")  # how geoms without names were called before version 0.3
# Before a number or a wildcard, a bracket belongs to an address.
_BRACKET = re.compile(r"\[(?=[\d*?]+\])")


def is_address(name: str) -> bool:
    """Return whether a name of a compiled scene stands for a missing one."""
    return _ADDRESS.fullmatch(name) is not None


def name_by_address(spec: mujoco.MjSpec) -> None:
    """Name what has no name in a specification by its address; a ValueError if it is invalid."""
    kinds = {kind: list(getattr(spec, plural)) for kind, plural in KINDS.items()}
    if all(element.name for elements in kinds.values() for element in elements):
        return
    ids = _compiled_ids(spec)
    for kind, elements in kinds.items():
        taken = {element.name for element in elements}
        for element, index in zip(elements, ids[kind], strict=True):
            if not element.name and index >= 0:
                address = f"{kind}[{index}]"
                while address in taken:
                    address += "_"
                element.name = address


def _compiled_ids(spec: mujoco.MjSpec) -> dict[str, Sequence[int]]:
    """Return the id of each element when the specification is compiled; -1 if it is left out."""
    if not (spec.compiler.fusestatic or spec.compiler.discardvisual):
        return {kind: range(len(getattr(spec, plural))) for kind, plural in KINDS.items()}
    trial = spec.copy()
    names: dict[str, list[str]] = {}
    for kind, plural in KINDS.items():
        elements: list[Any] = list(getattr(trial, plural))
        names[kind] = [element.name or f"?{place}" for place, element in enumerate(elements)]
        for element, name in zip(elements, names[kind], strict=True):
            element.name = name
    model = trial.compile()
    return {kind: [_id(model, kind, name) for name in members] for kind, members in names.items()}


def _id(model: mujoco.MjModel, kind: str, name: str) -> int:
    return mujoco.mj_name2id(model, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), name)


def find_id(model: mujoco.MjModel, kind: str, name: str) -> int:
    """Return the id of what has a name or an address in a compiled scene; -1 if nothing has."""
    found = _id(model, kind, name)
    old = _OLD_ADDRESS.fullmatch(name) if kind == "geom" and found < 0 else None
    return _id(model, kind, f"geom[{old[1]}]") if old else found


def name_of(model: mujoco.MjModel, kind: str, index: int) -> str:
    """Return the name of one of a kind; its address if nobody named it, as in a binary model."""
    return getattr(model, kind)(index).name or f"{kind}[{index}]"


def geom_words(model: mujoco.MjModel) -> dict[str, str]:
    """Return what is said of geoms that nobody named, by address: their body.

    Where that has several geoms the address is told too.
    """
    bodies: list[int] = model.geom_bodyid.tolist()
    count = Counter(bodies)
    names = ((name_of(model, "geom", geom), body) for geom, body in enumerate(bodies))
    return {
        name: name_of(model, "body", body) + (f" {name}" if count[body] > 1 else "")
        for name, body in names
        if is_address(name)
    }


def in_geom_words(model: mujoco.MjModel) -> Told:
    """Return what replaces addresses of geoms in a text, such as the name of a pair."""
    words = geom_words(model)
    return lambda text: _GEOM_ADDRESS.sub(lambda found: words.get(found[0], found[0]), text)


def geom_word(model: mujoco.MjModel, geom: int) -> str:
    """Return what is said of a geom: its name, or else its body."""
    name = name_of(model, "geom", geom)
    return geom_words(model).get(name, name)


def known_id(model: mujoco.MjModel, kind: Literal["body", "geom"], name: str) -> int:
    """Return the id of a body or geom; a SceneError if there is none of this name."""
    index = find_id(model, kind, name)
    if index < 0:
        known = [name_of(model, kind, member) for member in range(getattr(model, f"n{kind}"))]
        SceneError.unless_known(name, known, f"no {kind} '{name}' in the model")
        return known.index(name)
    return index


def matching(names: Iterable[str], pattern: str) -> list[str]:
    """Return the names that are or match a pattern such as `box*.x`, `leg[12]` or `actuator[*]`."""
    known = list(names)
    if pattern in known:
        return [pattern]
    literal = _BRACKET.sub("[[]", pattern)
    return [
        name
        for name in known
        if fnmatch.fnmatchcase(name, pattern) or fnmatch.fnmatchcase(name, literal)
    ]


PARTS = ("qpos", "qvel", "act", "ctrl", "applied", "mocap")
"""The parts of a state, and then those of its inputs, as `InitialStates` has them."""

_POSE = (".x", ".y", ".z", ".qw", ".qx", ".qy", ".qz")
_VELOCITY = (".vx", ".vy", ".vz", ".wx", ".wy", ".wz")
_FORCE = (".fx", ".fy", ".fz", ".tx", ".ty", ".tz")
_COMPONENTS = {
    int(mujoco.mjtJoint.mjJNT_FREE): (_POSE, _VELOCITY),
    int(mujoco.mjtJoint.mjJNT_BALL): (_POSE[3:], _VELOCITY[3:]),
}


def part_starts(model: mujoco.MjModel) -> dict[str, int]:
    """Return where each part starts in a row of all that `InitialStates` has of one run."""
    sizes = (model.nq, model.nv, model.na, model.nu, 6 * model.nbody)
    return dict(zip(PARTS, np.cumsum([0, *sizes]).tolist(), strict=True))


def coordinates(model: mujoco.MjModel) -> dict[str, int]:
    """Return the place of every coordinate of a model in such a row, by name.

    Slides and hinges are JOINT [m or rad] and JOINT.v; free and ball joints have a name for each
    component: positions and linear velocities in the world frame, angular velocities in the body
    frame. A joint without a name has its body's as well. BODY.fx to .tz are a constant external
    force [N] and torque [N m] at the body's centre of mass, world frame; ACTUATOR.ctrl is a
    constant control.
    """
    starts = part_starts(model)
    return dict([*_inputs(model, starts), *_named(model, starts)])


def mocap_coordinates(model: mujoco.MjModel) -> dict[str, int]:
    """Return BODY.x to .z [m] and .qw to .qz of every mocap body, as MuJoCo orders poses of all."""
    found, first = dict[str, int](), part_starts(model)["mocap"]
    for body in np.flatnonzero(np.asarray(model.body_mocapid) >= 0).tolist():
        name, place = name_of(model, "body", body), int(model.body_mocapid[body])
        starts = (*range(3 * place, 3 * place + 3), *range(4 * place, 4 * place + 4))
        for offset, (part, start) in enumerate(zip(_POSE, starts, strict=True)):
            found[name + part] = first + start + (3 * model.nmocap if offset >= 3 else 0)
    return found


def match_coordinates(model: mujoco.MjModel, pattern: str, *, mocap: bool = False) -> list[int]:
    """Return the coordinates, or also poses of mocap bodies, that match a pattern as `box*.x`.

    A SceneError says that nothing matches.
    """
    known = coordinates(model) | (mocap_coordinates(model) if mocap else {})
    found = dict.fromkeys(known[name] for name in matching(known, pattern))
    if not found:
        raise SceneError(f"the model has no coordinate '{pattern}'{did_you_mean(pattern, known)}")
    return list(found)


def input_names(model: mujoco.MjModel, places: Sequence[int] = ()) -> list[str]:
    """Return the names of some inputs by their indices, actuators' own; of all controls if none."""
    first = part_starts(model)["ctrl"]
    named = {place - first: name for name, place in coordinates(model).items()}
    names = (named[place] for place in places or range(model.nu))
    return [name.removesuffix(".ctrl") for name in names]


def _inputs(model: mujoco.MjModel, starts: Mapping[str, int]) -> Iterator[tuple[str, int]]:
    for body in range(1, model.nbody):
        for offset, part in enumerate(_FORCE):
            yield name_of(model, "body", body) + part, starts["applied"] + 6 * body + offset
    for actuator in range(model.nu):
        yield f"{name_of(model, 'actuator', actuator)}.ctrl", starts["ctrl"] + actuator


def _named(model: mujoco.MjModel, starts: Mapping[str, int]) -> Iterator[tuple[str, int]]:
    for index in range(model.njnt):
        joint, own = model.joint(index), name_of(model, "joint", index)
        positions, velocities = _COMPONENTS.get(int(joint.type[0]), (("",), (".v",)))
        bodies = [name_of(model, "body", model.jnt_bodyid[index])] if is_address(own) else []
        for name in (*bodies, own):
            for offset, part in enumerate(positions):
                yield name + part, int(joint.qposadr[0]) + offset
            for offset, part in enumerate(velocities):
                yield name + part, starts["qvel"] + int(joint.dofadr[0]) + offset
