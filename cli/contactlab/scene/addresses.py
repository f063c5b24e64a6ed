"""Addresses of what has no name in a model: `actuator[3]`, `joint[2]`, `geom[0]`, `key[0]`.

A compiled scene has them as names, so that whatever finds or prints a name has one word for each
thing. The number is its id in MuJoCo.
"""

import fnmatch
import re
from collections.abc import Iterable, Sequence
from typing import Any

import mujoco

# As MuJoCo calls one of a kind, and all of them in a specification.
_KINDS = {
    "body": "bodies",
    "joint": "joints",
    "geom": "geoms",
    "pair": "pairs",
    "equality": "equalities",
    "tendon": "tendons",
    "actuator": "actuators",
    "key": "keys",
}
_ADDRESS = re.compile(rf"({'|'.join(_KINDS)})\[\d+\]_*")
# How geoms without names were called before version 0.3.
_OLD_ADDRESS = re.compile(r"geom(\d+)")
# Before a number or a wildcard, a bracket belongs to an address.
_BRACKET = re.compile(r"\[(?=[\d*?]+\])")


def is_address(name: str) -> bool:
    """Return whether a name of a compiled scene stands for a missing one."""
    return _ADDRESS.fullmatch(name) is not None


def name_by_address(spec: mujoco.MjSpec) -> None:
    """Give whatever has no name in a specification its address for one.

    Raises:
        ValueError: the specification does not compile.
    """
    kinds = {kind: list(getattr(spec, plural)) for kind, plural in _KINDS.items()}
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
        return {kind: range(len(getattr(spec, plural))) for kind, plural in _KINDS.items()}
    trial = spec.copy()
    names: dict[str, list[str]] = {}
    for kind, plural in _KINDS.items():
        elements: list[Any] = list(getattr(trial, plural))
        names[kind] = [each.name or f"?{place}" for place, each in enumerate(elements)]
        for element, name in zip(elements, names[kind], strict=True):
            element.name = name
    model = trial.compile()
    return {kind: [_id(model, kind, name) for name in each] for kind, each in names.items()}


def _id(model: mujoco.MjModel, kind: str, name: str) -> int:
    return mujoco.mj_name2id(model, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), name)


def find_id(model: mujoco.MjModel, kind: str, name: str) -> int:
    """Return the id of what has a name or an address in a compiled scene; -1 if nothing has.

    Args:
        model: compiled of the scene.
        kind: such as `body`, `joint` or `geom`.
        name: its name or address.
    """
    found = _id(model, kind, name)
    old = _OLD_ADDRESS.fullmatch(name) if kind == "geom" and found < 0 else None
    return _id(model, kind, f"geom[{old[1]}]") if old else found


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
