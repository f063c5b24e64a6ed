"""The quantities of compared parts of models, and the sizes of their changes."""

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import mujoco
import numpy as np

from contactlab.contact.rotations import rotation_matrices
from contactlab.contact.trace_arrays import Floats
from contactlab.scene.body_inertia import geom_volume
from contactlab.scene.model_names import name_of
from contactlab.scene.model_text import mjcf_text
from contactlab.scene.mujoco_versions import enum_members

Scale = Literal["value", "numbers", "length", "turn", "word"]
Reader = Callable[[mujoco.MjModel, int], object]


class Quantity(NamedTuple):
    """A quantity of a part.

    A value changes by its relative change, numbers of unlike units by the largest of one of them, a
    length by its share of the part's reach, a turn by its angle, and a word as a whole.
    """

    name: str
    reader: Reader
    unit: str = ""
    scale: Scale = "value"


def _read_field(field: str) -> Reader:
    return lambda model, index: getattr(model, field)[index]


def _read_inertia(model: mujoco.MjModel, body: int) -> Floats:
    """Return (3, 3) the inertia about the center of mass, in the frame of the body."""
    turn = rotation_matrices(np.asarray(model.body_iquat)[[body]])[0]
    return turn @ np.diag(model.body_inertia[body]) @ turn.T


def _read_limits(field: str, flag: str) -> Reader:
    """Return the reader of a range, which is "none" without one."""

    def read(model: mujoco.MjModel, index: int) -> object:
        return getattr(model, field)[index] if getattr(model, flag)[index] else "none"

    return read


def _read_name(kind: str, field: str) -> Reader:
    return lambda model, index: name_of(model, kind, int(getattr(model, field)[index]))


def _read_word(field: str, kinds: Any, prefix: str) -> Reader:  # noqa: ANN401 - a pybind11 enum
    words = {value: name for name, value in enum_members(kinds, prefix).items()}

    def read(model: mujoco.MjModel, index: int) -> object:
        return words.get(int(getattr(model, field)[index]), "").lower()

    return read


_TARGETS = {
    int(mujoco.mjtTrn.mjTRN_JOINT): "joint",
    int(mujoco.mjtTrn.mjTRN_JOINTINPARENT): "joint",
    int(mujoco.mjtTrn.mjTRN_TENDON): "tendon",
    int(mujoco.mjtTrn.mjTRN_SITE): "site",
    int(mujoco.mjtTrn.mjTRN_BODY): "body",
}


def _read_target(model: mujoco.MjModel, actuator: int) -> object:
    kind = _TARGETS.get(int(model.actuator_trntype[actuator]), "")
    return f"{kind} {name_of(model, kind, int(model.actuator_trnid[actuator, 0]))}" if kind else ""


_ACTING = {  # numbers of a size that act, of three
    int(mujoco.mjtGeom.mjGEOM_SPHERE): 1,
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): 2,
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): 2,
    int(mujoco.mjtGeom.mjGEOM_PLANE): 0,
}


def _solid_size(model: mujoco.MjModel, geom: int) -> object:
    """Return the sizes of a primitive that matter, or the half extents of a mesh."""
    kind = int(model.geom_type[geom])
    if kind in (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SDF):
        return model.geom_aabb[geom, 3:]
    return model.geom_size[geom, : _ACTING.get(kind, 3)]


_FLAT = (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD))


def _read_volume(model: mujoco.MjModel, geom: int) -> float:
    """Return the volume of a geom [m^3], for a mesh that of its hull; 0 of a plane or a field."""
    return 0.0 if int(model.geom_type[geom]) in _FLAT else geom_volume(model, geom)


def _joint_turns(field: str) -> Reader:
    def read(model: mujoco.MjModel, joint: int) -> object:
        return getattr(model, field)[int(model.jnt_dofadr[joint])]

    return read


def _joint_place(field: str) -> Reader:
    """Return the reader of a position of slides and hinges."""

    def read(model: mujoco.MjModel, joint: int) -> object:
        scalar = model.jnt_type[joint] in (2, 3)
        return getattr(model, field)[int(model.jnt_qposadr[joint])] if scalar else 0.0

    return read


_JOINT_UNIT = "m or rad"
QUANTITIES: dict[str, tuple[Quantity, ...]] = {
    "body": (
        Quantity("name", lambda model, body: name_of(model, "body", body), "", "word"),
        Quantity("parent", _read_name("body", "body_parentid"), "", "word"),
        Quantity("mass", _read_field("body_mass"), "kg"),
        Quantity("com", _read_field("body_ipos"), "m", "length"),
        Quantity("inertia", _read_inertia, "kg m^2"),
        Quantity("pos", _read_field("body_pos"), "m", "length"),
        Quantity("quat", _read_field("body_quat"), "", "turn"),
        Quantity("gravcomp", _read_field("body_gravcomp"), ""),
        Quantity("mocap", lambda m, body: bool(m.body_mocapid[body] >= 0), "", "word"),
    ),
    "joint": (
        Quantity("name", lambda model, joint: name_of(model, "joint", joint), "", "word"),
        Quantity("body", _read_name("body", "jnt_bodyid"), "", "word"),
        Quantity("type", _read_word("jnt_type", mujoco.mjtJoint, "mjJNT_"), "", "word"),
        Quantity("axis", _read_field("jnt_axis"), ""),
        Quantity("pos", _read_field("jnt_pos"), "m", "length"),
        Quantity("range", _read_limits("jnt_range", "jnt_limited"), _JOINT_UNIT),
        Quantity("damping", _joint_turns("dof_damping"), "N s/m or N m s/rad"),
        Quantity("armature", _joint_turns("dof_armature"), "kg or kg m^2"),
        Quantity("frictionloss", _joint_turns("dof_frictionloss"), "N or N m"),
        Quantity("stiffness", _read_field("jnt_stiffness"), "N/m or N m/rad"),
        Quantity("springref", _joint_place("qpos_spring"), _JOINT_UNIT),
        Quantity("ref", _joint_place("qpos0"), _JOINT_UNIT),
        Quantity("margin", _read_field("jnt_margin"), _JOINT_UNIT),
        Quantity("solreflimit", _read_field("jnt_solref"), "", "numbers"),
        Quantity("solimplimit", _read_field("jnt_solimp"), "", "numbers"),
        Quantity("solreffriction", _joint_turns("dof_solref"), "", "numbers"),
        Quantity("solimpfriction", _joint_turns("dof_solimp"), "", "numbers"),
        Quantity(
            "actuatorfrcrange", _read_limits("jnt_actfrcrange", "jnt_actfrclimited"), "N or N m"
        ),
        Quantity("actuatorgravcomp", _read_field("jnt_actgravcomp"), "", "word"),
    ),
    "geom": (
        Quantity("body", _read_name("body", "geom_bodyid"), "", "word"),
        Quantity("type", _read_word("geom_type", mujoco.mjtGeom, "mjGEOM_"), "", "word"),
        Quantity("size", _solid_size, "m"),
        Quantity("volume", _read_volume, "m^3"),
        Quantity("pos", _read_field("geom_pos"), "m", "length"),
        Quantity("quat", _read_field("geom_quat"), "", "turn"),
        Quantity("contype", _read_field("geom_contype"), "", "word"),
        Quantity("conaffinity", _read_field("geom_conaffinity"), "", "word"),
        Quantity("condim", _read_field("geom_condim"), "", "word"),
        Quantity("priority", _read_field("geom_priority"), "", "word"),
        Quantity("friction", _read_field("geom_friction"), "", "numbers"),
        Quantity("solref", _read_field("geom_solref"), "", "numbers"),
        Quantity("solimp", _read_field("geom_solimp"), "", "numbers"),
        Quantity("solmix", _read_field("geom_solmix"), ""),
        Quantity("margin", _read_field("geom_margin"), "m"),
        Quantity("gap", _read_field("geom_gap"), "m"),
    ),
    "tendon": (
        Quantity("stiffness", _read_field("tendon_stiffness"), "N/m"),
        Quantity("damping", _read_field("tendon_damping"), "N s/m"),
        Quantity("armature", _read_field("tendon_armature"), "kg"),
        Quantity("frictionloss", _read_field("tendon_frictionloss"), "N"),
        Quantity("range", _read_limits("tendon_range", "tendon_limited"), "m"),
        Quantity("springlength", _read_field("tendon_lengthspring"), "m"),
        Quantity("length at qpos0", _read_field("tendon_length0"), "m"),
        Quantity("solreflimit", _read_field("tendon_solref_lim"), "", "numbers"),
    ),
    "actuator": (
        Quantity("transmission", _read_target, "", "word"),
        Quantity("gear", _read_field("actuator_gear"), ""),
        Quantity("ctrlrange", _read_limits("actuator_ctrlrange", "actuator_ctrllimited"), ""),
        Quantity("forcerange", _read_limits("actuator_forcerange", "actuator_forcelimited"), "N"),
        Quantity("actrange", _read_limits("actuator_actrange", "actuator_actlimited"), ""),
        Quantity("dyntype", _read_word("actuator_dyntype", mujoco.mjtDyn, "mjDYN_"), "", "word"),
        Quantity("dynprm", _read_field("actuator_dynprm"), "", "numbers"),
        Quantity(
            "gaintype", _read_word("actuator_gaintype", mujoco.mjtGain, "mjGAIN_"), "", "word"
        ),
        Quantity("gainprm", _read_field("actuator_gainprm"), "", "numbers"),
        Quantity(
            "biastype", _read_word("actuator_biastype", mujoco.mjtBias, "mjBIAS_"), "", "word"
        ),
        Quantity("biasprm", _read_field("actuator_biasprm"), "", "numbers"),
    ),
    "equality": (
        Quantity("type", _read_word("eq_type", mujoco.mjtEq, "mjEQ_"), "", "word"),
        Quantity("active", _read_field("eq_active0"), "", "word"),
        Quantity("data", _read_field("eq_data"), ""),
        Quantity("solref", _read_field("eq_solref"), "", "numbers"),
        Quantity("solimp", _read_field("eq_solimp"), "", "numbers"),
    ),
    "pair": (
        Quantity("geom1", _read_name("geom", "pair_geom1"), "", "word"),
        Quantity("geom2", _read_name("geom", "pair_geom2"), "", "word"),
        Quantity("condim", _read_field("pair_dim"), "", "word"),
        Quantity("friction", _read_field("pair_friction"), "", "numbers"),
        Quantity("solref", _read_field("pair_solref"), "", "numbers"),
        Quantity("solimp", _read_field("pair_solimp"), "", "numbers"),
        Quantity("margin", _read_field("pair_margin"), "m"),
        Quantity("gap", _read_field("pair_gap"), "m"),
    ),
    "key": (
        Quantity("qpos", _read_field("key_qpos"), _JOINT_UNIT),
        Quantity("qvel", _read_field("key_qvel"), "m/s or rad/s"),
        Quantity("ctrl", _read_field("key_ctrl"), ""),
    ),
}
"""By kind of part, in the order of reports."""


def relative_change(scale: Scale, before: object, after: object, length: float) -> float | None:
    """Return the change of a value, relative to the one before; None if that has no size.

    It is 0 if there is no change. Positions are divided by the length of the part [m].
    """
    if scale == "word" or isinstance(before, str) or isinstance(after, str):
        return 0.0 if np.array_equal(np.asarray(before), np.asarray(after)) else None
    one, two = (np.asarray(side, np.float64) for side in (before, after))
    if one.shape != two.shape:
        return None
    if scale == "numbers":
        known = np.nan_to_num(one), np.nan_to_num(two)
        old, new = (side[known[0] != known[1]] for side in known)
        return float(np.abs(new / old - 1).max(initial=0.0)) if old.all() else None
    # A value that was never set may be NaN in both.
    apart = np.linalg.norm(np.nan_to_num(one - two))
    if scale == "turn":
        # Opposite quaternions are one turn.
        chord = min(np.linalg.norm(one - two), np.linalg.norm(one + two))
        return float(4 * np.arcsin(min(1.0, chord / 2)))
    size = length if scale == "length" else np.linalg.norm(np.nan_to_num(one))
    if not apart:
        return 0.0
    return float(apart / size) if size else None


def format_value(value: object) -> str:
    """Return a value to six digits, as MJCF has it."""
    if isinstance(value, (str, bool)):
        return str(value)
    numbers = np.atleast_1d(np.asarray(value)).ravel()
    if not numbers.size:
        return "none"
    trimmed_numbers = np.trim_zeros(numbers, "b") if numbers.size > 6 else numbers
    shown_numbers = trimmed_numbers if trimmed_numbers.size else numbers[:1]
    return " ".join(mjcf_text(float(f"{number:.6g}")) for number in shown_numbers.tolist())
