"""Reads a model's options, flags, contact parameters and fields as settings, and writes them.

Flags are MuJoCo's disable and enable bits in the installed version; each is an effect of the same
name.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import mujoco
import numpy as np

from contactlab.errors import SceneError, did_you_mean
from contactlab.mjcf import CONTACT, DISTANCE_FIELDS, MODEL_ENGINE, OPTIONS
from contactlab.scene.contact_pairs import MonitoredPair, effective_parameters, explicit_pair
from contactlab.scene.model_names import find_id
from contactlab.scene.mujoco_versions import enum_members
from contactlab.scene.parameters import PARAMETERS, WORDS
from contactlab.schema.setting_values import Settings, as_number, integer_parser, number_parser
from contactlab.schema.vocabulary import AxisSpec

_FIELD_NAME = re.compile(
    r"(?P<field>[a-z]\w*)\[(?P<object>[^,\]]+(\[\d+\]_*)?)(,(?P<place>\d+))?\]"
)
FIELD_KINDS = {
    "body": "body",
    "jnt": "joint",
    "dof": "joint",
    "geom": "geom",
    "pair": "pair",
    "eq": "equality",
    "tendon": "tendon",
    "actuator": "actuator",
}
"""Kind of object for the prefix of a field."""
# Addresses, counts, ids and types are structure, which MuJoCo does not check. Bounds, inertia and
# broad phase are derived from sizes only when a model is compiled. Collision bits decide which
# pairs are monitored.
_STRUCTURE_FIELDS = (
    "adr|num|id|type|simple|sameframe|limited|signature|geom1|geom2|plugin|history|ctrlspec|size"
    "|rbound|aabb|conaffinity"
)
# MuJoCo derives these from other fields, and would overwrite them.
_DERIVED_FIELDS = "weight0|subtreemass|M0|length0|acc0|lengthrange|dof_length|body_margin"
_READ_ONLY_FIELDS = re.compile(f"({_STRUCTURE_FIELDS}|{_DERIVED_FIELDS})$")


def field_axis(model: mujoco.MjModel, name: str) -> AxisSpec | None:
    """Return the axis of a model field, or None if the name does not have the form of a field.

    A ValueError says that the field, object or index does not exist.
    """
    if (field_place := find_field(model, name)) is None:
        return None
    array, index = field_place
    width = int(np.size(array[index]))
    one: Callable[[object], object]
    if re.match(r"(geom_condim|pair_dim)\b", name):
        one = PARAMETERS["condim"].parse
    elif array.dtype.kind == "b":
        one = integer_parser(0, 1)
    elif array.dtype.kind in "iu":
        bounds = np.iinfo(array.dtype)
        one = integer_parser(int(bounds.min), int(bounds.max))
    else:
        one = number_parser()

    def parse(value: object) -> object:
        parts = value.split() if isinstance(value, str) else value
        many = list(parts) if isinstance(parts, (list, tuple)) else [parts]
        if len(many) != width:
            raise ValueError(f"write {width} numbers for {name}, not {value!r}")
        numbers = tuple(one(part) for part in many)
        return numbers[0] if width == 1 else numbers

    return AxisSpec(name, "", "MuJoCo's model field", parse)


def is_as_written(model: mujoco.MjModel, name: str, value: object) -> bool:
    """Return whether a setting is a model field that already has this value.

    Options of distance fields count as fields, since few runs have them as settings.
    """
    if name in DISTANCE_FIELDS:
        return bool(getattr(model.opt, name) == value)
    if (field_place := find_field(model, name)) is None:
        return False
    array, index = field_place
    return bool(np.all(array[index] == np.asarray(value, array.dtype)))


def find_field(model: mujoco.MjModel, name: str) -> tuple[np.ndarray, tuple[int, ...]] | None:
    """Return a field's array and the index of the named row or element; None for other names."""
    parts = _FIELD_NAME.fullmatch(name)
    if parts is None:
        return None
    field, item, place = parts["field"], parts["object"], parts["place"]
    kind = FIELD_KINDS.get(field.partition("_")[0])
    array = getattr(model, field, None)
    if kind is None or not isinstance(array, np.ndarray) or not is_writable(field):
        field_names = [attribute for attribute in dir(model) if is_writable(attribute)]
        raise ValueError(
            f"'{field}' is not a model field that can be swept{did_you_mean(field, field_names)}"
        )
    row = find_id(model, kind, item)
    if row < 0:
        raise ValueError(f"no {kind} named '{item}' in the model")
    if field.startswith("dof_"):
        row = int(model.jnt_dofadr[row])
    index = (row,) if place is None else (row, int(place))
    if len(index) > array.ndim or (place and int(place) >= array.shape[1]):
        raise ValueError(f"'{field}' has no index {place}; its shape is {array.shape}")
    return array, index


def is_writable(field: str) -> bool:
    """Return whether a model's field can be written: it is neither structure nor derived."""
    return field.partition("_")[0] in FIELD_KINDS and not _READ_ONLY_FIELDS.search(field)


@dataclass(frozen=True)
class EditTargets:
    """Geoms, pairs and body that contact and mass settings are written to.

    Contact settings go to the geoms and the explicit <pair> elements of the monitored pairs, `mass`
    to the subject, if there is one.
    """

    geoms: tuple[int, ...]
    explicit: tuple[int, ...]
    subject: int | None

    def rows_of_targets(self, field: str) -> list[int]:
        """Return the rows of the targets in a field of geoms or of <pair> elements."""
        return list(self.geoms if field.startswith("geom") else self.explicit)


def find_targets(
    model: mujoco.MjModel, pairs: Sequence[MonitoredPair], subject: int | None
) -> EditTargets:
    """Return the geoms and <pair> elements of the monitored pairs."""
    geoms: set[int] = set()
    explicit: set[int] = set()
    for both in (both for pair in pairs for both in product(*pair.geoms)):
        index = explicit_pair(model, *both)
        if index is None:
            geoms.update(both)
        else:
            explicit.add(index)
    return EditTargets(tuple(sorted(geoms)), tuple(sorted(explicit)), subject)


def nonuniform_settings(
    model: mujoco.MjModel, settings: Settings, targets: EditTargets
) -> frozenset[str]:
    """Return the contact settings that differ from `settings` at some target."""
    return frozenset(
        name
        for name in CONTACT
        if name in settings
        for field, row in _setting_rows(name, settings[name]).items()
        if np.any(getattr(model, field)[targets.rows_of_targets(field)] != row)
    )


def _setting_rows(name: str, value: object) -> dict[str, np.ndarray]:
    """Return the model fields of a contact setting, each with the value of its rows.

    Every monitored geom gets the pair's value, because mixing equal values returns that value.
    """
    row = np.asarray(value)
    if name == "friction":
        return {"geom_friction": row[[0, 2, 3]], "pair_friction": row}
    if name == "condim":
        return {"geom_condim": row, "pair_dim": row}
    # MuJoCo adds the margins, and the gaps, of the two geoms.
    half = row / 2 if name in ("margin", "gap") else row
    return {f"geom_{name}": half, f"pair_{name}": row}


def write_settings(
    model: mujoco.MjModel, changed: Mapping[str, object], targets: EditTargets
) -> bool:
    """Write changed settings and flags into a model.

    Return whether derived fields must be renewed.
    """
    inputs, derived = getattr(mujoco.MjModel, "_setconst_inputs", ()), False
    flags = dict[str, bool]()
    for name, value in changed.items():
        if name in FLAG_NAMES:
            flags[name] = bool(value)
        if name in OPTIONS:
            write_option(model, name, value)
            derived |= name == "timestep" and has_step_factors(model)
        elif name in CONTACT:
            for field, row in _setting_rows(name, value).items():
                getattr(model, field)[targets.rows_of_targets(field)] = row
            derived |= name in ("margin", "gap")
        elif name == "mass":
            # Mass and inertia scale equally, as with another density.
            mass = as_number(value)
            if targets.subject is None:
                raise SceneError("`mass` needs a subject; name a body in the scene's `subject`")
            ratio = mass / float(model.body_mass[targets.subject])
            model.body_mass[targets.subject] = mass
            model.body_inertia[targets.subject] *= ratio
            derived = True
        elif field_place := find_field(model, name):
            array, index = field_place
            array[index] = value
            derived |= not inputs or name.partition("[")[0] in inputs
    write_flags(model, flags)
    return derived


def derive_fields(model: mujoco.MjModel) -> None:
    """Let MuJoCo derive the dependent fields of a model, and its mean inertia, in place.

    The mean inertia, a scale of the solver's tolerance, is kept if the author set another value.
    """
    own = model.stat.meaninertia != _mean_inertia(model)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    if not own:
        model.stat.meaninertia = _mean_inertia(model)


def set_timestep(model: mujoco.MjModel, timestep: float) -> None:
    """Write a timestep [s] into a model, with the factors that depend on it."""
    model.opt.timestep = timestep
    if has_step_factors(model):
        derive_fields(model)


def has_step_factors(model: mujoco.MjModel) -> bool:
    """Return whether a compiled model depends on its step, as elastic flexes do since 4.0."""
    return getattr(model, "nefm0L", 0) > 0


def _mean_inertia(model: mujoco.MjModel) -> float:
    """Return the mean inertia of degrees of freedom, summed as in MuJoCo's compiler."""
    return sum(model.dof_M0.tolist()) / max(1, model.nv)


# Recording needs these values: sensors provide the evidence, an automatic reset would hide a
# divergence, and the energy flag makes the kinetic energy sensor lag by a step.
_RECORDING_FLAGS = {"sensor": True, "autoreset": False, "energy": False, "fwdinv": False}
# Override replaces the contact parameters of every geom, including those of a sweep.
_UNSUPPORTED_FLAGS = {"ipc", "override"}
_DISABLE_BITS, _ENABLE_BITS = (
    {name.lower(): bit for name, bit in enum_members(enum, prefix).items()}
    for enum, prefix in ((mujoco.mjtDisableBit, "mjDSBL_"), (mujoco.mjtEnableBit, "mjENBL_"))
)
FLAG_NAMES = tuple(
    sorted(
        (_DISABLE_BITS.keys() | _ENABLE_BITS.keys()) - _RECORDING_FLAGS.keys() - _UNSUPPORTED_FLAGS
    )
)


def read_flags(model: mujoco.MjModel) -> dict[str, bool]:
    """Return every flag of a model; True means that its effect is on."""
    return {
        name: read_flag(model, name) for name in sorted(_DISABLE_BITS | _ENABLE_BITS)
    } | _RECORDING_FLAGS


def read_flag(model: mujoco.MjModel, name: str) -> bool:
    """Return one flag of a model; True if its effect is on. The version may lack the flag."""
    if name in _DISABLE_BITS:
        return not int(model.opt.disableflags) & _DISABLE_BITS[name]
    return bool(int(model.opt.enableflags) & _ENABLE_BITS.get(name, 0))


def non_default_flags(states: Mapping[str, bool]) -> dict[str, bool]:
    """Return the flags that differ from MuJoCo's defaults.

    A version without a flag behaves as with its default, so the result is the same for every
    version.
    """
    return {name: state for name, state in states.items() if state != (name in _DISABLE_BITS)}


def write_flags(model: mujoco.MjModel, states: Mapping[str, bool]) -> None:
    """Set flags, and those that recording needs."""
    for name, state in {**states, **_RECORDING_FLAGS}.items():
        disable = name in _DISABLE_BITS
        field, bit = (
            ("disableflags", _DISABLE_BITS[name])
            if disable
            else ("enableflags", _ENABLE_BITS[name])
        )
        others = int(getattr(model.opt, field)) & ~bit
        setattr(model.opt, field, others | bit if state != disable else others)


LOOP_ENGINE = "loop"
"""Engine name of a user's own simulation loop; the store has its compiled model."""


def base_settings(
    model: mujoco.MjModel, pairs: Sequence[MonitoredPair], subject: int | None
) -> Settings:
    """Return every setting of a compiled model, before a sweep changes any.

    Contact settings are those of the first monitored pair, because a sweep sets them for all pairs;
    `mass` is the subject's, if there is one.
    """
    settings = Settings(engine=MODEL_ENGINE)
    usual = mujoco.MjOption()
    settings |= {
        name: read_option(model, name)
        for name in OPTIONS
        if name not in DISTANCE_FIELDS or getattr(model.opt, name) != getattr(usual, name)
    }
    if pairs:
        parameters = effective_parameters(model, pairs[0])
        settings |= {name: getattr(parameters, name) for name in CONTACT}
    if subject is not None:
        settings["mass"] = float(model.body_mass[subject])
    return settings


def read_option(model: mujoco.MjModel, name: str) -> object:
    """Return an attribute of <option> as a setting: a number, a word or a tuple of numbers."""
    value = getattr(model.opt, name)
    if name in WORDS:
        return WORDS[name][value]
    return tuple(value.tolist()) if isinstance(value, np.ndarray) else value


def write_option(model: mujoco.MjModel, name: str, value: object) -> None:
    """Write a setting into a model's options, in place."""
    setattr(model.opt, name, WORDS[name].index(str(value)) if name in WORDS else value)
