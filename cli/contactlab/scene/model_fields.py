"""Any MjModel field by name, as an axis: `dof_damping[hinge]`, `geom_friction[pad,1]`."""

import re
from collections.abc import Callable

import mujoco
import numpy as np

from contactlab.errors import did_you_mean
from contactlab.scene.parameters import PARAMETERS
from contactlab.scene.setting_values import integer, number
from contactlab.schema import AxisSpec

_NAME = re.compile(r"(?P<field>[a-z]\w*)\[(?P<object>[^,\]]+)(,(?P<place>\d+))?\]")
_KINDS = {
    "body": mujoco.mjtObj.mjOBJ_BODY,
    "jnt": mujoco.mjtObj.mjOBJ_JOINT,
    "dof": mujoco.mjtObj.mjOBJ_JOINT,
    "geom": mujoco.mjtObj.mjOBJ_GEOM,
    "pair": mujoco.mjtObj.mjOBJ_PAIR,
    "eq": mujoco.mjtObj.mjOBJ_EQUALITY,
    "tendon": mujoco.mjtObj.mjOBJ_TENDON,
    "actuator": mujoco.mjtObj.mjOBJ_ACTUATOR,
}
# Addresses, counts, ids and types are structure, which MuJoCo does not check; bounds, inertia and
# broad phase are derived from sizes when a model is compiled, and not later; collision bits decide
# which pairs are monitored.
_STRUCTURE = re.compile(
    r"(adr|num|id|type|simple|sameframe|limited|signature|geom1|geom2|plugin|history|ctrlspec|size|rbound"
    r"|aabb|conaffinity)$"
)
# MuJoCo derives these from other fields, and would overwrite them.
_DERIVED = re.compile(r"(weight0|subtreemass|M0|length0|acc0|lengthrange|dof_length|body_margin)$")


def field_axis(model: mujoco.MjModel, name: str) -> AxisSpec | None:
    """Return the axis of a model field, or None if the name is not of that form.

    Raises:
        ValueError: it has that form, but names no such field, object or index.
    """
    parts = _NAME.fullmatch(name)
    if parts is None:
        return None
    _locate(model, name)
    text = "MuJoCo's model field"
    return AxisSpec(name, "", text, _parser(model, name))


def is_field(model: mujoco.MjModel, name: str) -> bool:
    """Return whether a setting is a model field."""
    return field_axis(model, name) is not None


def is_as_written(model: mujoco.MjModel, name: str, value: object) -> bool:
    """Return whether a setting is a model field that has this value already."""
    if not is_field(model, name):
        return False
    array, index = _locate(model, name)
    return bool(np.all(array[index] == np.asarray(value, array.dtype)))


def write_field(model: mujoco.MjModel, name: str, value: object) -> bool:
    """Write a model field; return whether constants derived from it must be recomputed."""
    array, index = _locate(model, name)
    array[index] = value
    inputs = getattr(mujoco.MjModel, "_setconst_inputs", ())
    return not inputs or name.partition("[")[0] in inputs


def _locate(model: mujoco.MjModel, name: str) -> tuple[np.ndarray, tuple[int, ...]]:
    """Return the field's array and the index of the named object's row or element."""
    parts = _NAME.fullmatch(name)
    assert parts is not None
    field, item, place = parts["field"], parts["object"], parts["place"]
    kind = _KINDS.get(field.partition("_")[0])
    array = getattr(model, field, None)
    if kind is None or not isinstance(array, np.ndarray) or _is_fixed(field):
        known = [
            each for each in dir(model) if each.partition("_")[0] in _KINDS and not _is_fixed(each)
        ]
        raise ValueError(
            f"'{field}' is not a model field that can be swept{did_you_mean(field, known)}"
        )
    row = mujoco.mj_name2id(model, kind, item)
    if row < 0:
        raise ValueError(f"no {field.partition('_')[0]} named '{item}' in the model")
    if field.startswith("dof_"):
        row = int(model.jnt_dofadr[row])
    index = (row,) if place is None else (row, int(place))
    if len(index) > array.ndim or (place and int(place) >= array.shape[1]):
        raise ValueError(f"'{field}' has no index {place}; its shape is {array.shape}")
    return array, index


def _is_fixed(field: str) -> bool:
    return bool(_STRUCTURE.search(field) or _DERIVED.search(field))


def _parser(model: mujoco.MjModel, name: str) -> Callable[[object], object]:
    array, index = _locate(model, name)
    width = int(np.size(array[index]))
    condim = re.match(r"(geom_condim|pair_dim)\b", name)
    one = PARAMETERS["condim"].axis.parse if condim else _element_parser(array.dtype)

    def parse(value: object) -> object:
        parts = value.split() if isinstance(value, str) else value
        many = list(parts) if isinstance(parts, (list, tuple)) else [parts]
        if len(many) != width:
            raise ValueError(f"write {width} numbers for {name}, not {value!r}")
        numbers = tuple(one(part) for part in many)
        return numbers[0] if width == 1 else numbers

    return parse


def _element_parser(kind: np.dtype) -> Callable[[object], float]:
    if kind.kind == "b":
        return integer(0, 1)
    if kind.kind in "iu":
        bounds = np.iinfo(kind)
        return integer(int(bounds.min), int(bounds.max))
    return number()
