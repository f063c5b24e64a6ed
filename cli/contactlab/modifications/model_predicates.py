"""Predicates on compiled models: whether a model has the setting that a modification changes."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.modifications.modification import ModelPredicate
from contactlab.scene.model_edits import FLAG_NAMES, read_flag
from contactlab.scene.part_bodies import is_mocap_driven
from contactlab.scene.unreachable import filtered_pairs

CLAMP_FLAG = "clampctrl"


SLEEP_BIT = int(getattr(mujoco.mjtEnableBit, "mjENBL_SLEEP", 0))
PYRAMIDAL, ELLIPTIC = int(mujoco.mjtCone.mjCONE_PYRAMIDAL), int(mujoco.mjtCone.mjCONE_ELLIPTIC)
NO_FRICTION, SLIDING = 1, 3
"""Contact dimensions without friction, and without torsion and rolling."""


def has_no_flex(model: mujoco.MjModel) -> bool:
    """Return whether any integrator is allowed: some refuse the elasticity of flexes."""
    return model.nflex == 0


def has_nonzero(*fields: str) -> ModelPredicate:
    """Return whether any number of a model's fields is not 0."""

    def applies_to(model: mujoco.MjModel) -> bool:
        return any(np.any(getattr(model, field)) for field in fields if hasattr(model, field))

    return applies_to


def is_disabled(model: mujoco.MjModel, name: str) -> bool:
    """Return whether an effect is switched off in a model's options."""
    return bool(model.opt.disableflags & find_disable_bit(name))


def find_disable_bit(name: str) -> int:
    """Return the bit that disables an effect, 0 if this MuJoCo does not have it."""
    return int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name.upper()}", 0))


def has_gravity(model: mujoco.MjModel) -> bool:
    """Return whether gravity acts in a model."""
    return bool(model.opt.gravity.any()) and not is_disabled(model, "gravity")


def read_gravity(model: mujoco.MjModel) -> float:
    """Return the magnitude of a model's gravity, 0 where it is switched off [m/s^2]."""
    return 0.0 if is_disabled(model, "gravity") else float(np.linalg.norm(model.opt.gravity))


def has_condim_above(least: int) -> ModelPredicate:
    """Return whether contacts of a model may have more dimensions than some."""

    def applies_to(model: mujoco.MjModel) -> bool:
        dims = (model.geom_condim, model.pair_dim, model.flex_condim)
        return may_collide(model) and any((dim > least).any() for dim in dims)

    return applies_to


_ITERATED = tuple(
    int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}"))
    for name in ("ELLIPSOID", "CYLINDER", "BOX", "MESH", "HFIELD", "SDF")
)


def has_iterated_collision(model: mujoco.MjModel) -> bool:
    """Return whether collisions of a model are iterated, of convex shapes more coarsely than usual.

    With the default settings, convex collisions converge.
    """
    types = _find_colliding_types(model)
    usual = mujoco.MjOption()
    coarse = (
        model.opt.ccd_iterations < usual.ccd_iterations
        or model.opt.ccd_tolerance > usual.ccd_tolerance
    )
    coarse &= bool(types & {*_ITERATED})
    return may_collide(model) and (has_distance_fields(model) or coarse)


def has_distance_fields(model: mujoco.MjModel) -> bool:
    """Return whether signed distance fields may collide."""
    return int(mujoco.mjtGeom.mjGEOM_SDF) in _find_colliding_types(model)


def _find_colliding_types(model: mujoco.MjModel) -> set[int]:
    return set(model.geom_type[(model.geom_contype | model.geom_conaffinity) != 0].tolist())


def has_single_contacts(model: mujoco.MjModel) -> bool:
    """Return whether convex shapes that meet in a face may have a single contact."""
    return "multiccd" in FLAG_NAMES and not read_flag(model, "multiccd") and may_collide(model)


def may_collide(model: mujoco.MjModel) -> bool:
    """Return whether contacts can arise in a model."""
    if is_disabled(model, "contact") or is_disabled(model, "constraint"):
        return False
    types = np.bitwise_or.reduce(
        np.concatenate([model.geom_contype, model.flex_contype]), initial=0
    )
    affinities = np.bitwise_or.reduce(
        np.concatenate([model.geom_conaffinity, model.flex_conaffinity]), initial=0
    )
    inside = model.flex_selfcollide.any()
    return bool(types & affinities or inside or model.npair)


def has_clamps(model: mujoco.MjModel) -> bool:
    """Return whether controls or forces of a model are limited."""
    ctrl = not is_disabled(model, CLAMP_FLAG) and model.actuator_ctrllimited.any()
    force = (model.actuator_forcelimited, model.jnt_actfrclimited, model.tendon_actfrclimited)
    return bool(ctrl or any(field.any() for field in force))


def has_fluid(model: mujoco.MjModel) -> bool:
    """Return whether a model has a medium."""
    return bool(model.opt.density or model.opt.viscosity)


def has_equalities(model: mujoco.MjModel) -> bool:
    """Return whether a model has active equalities."""
    return bool(model.neq) and not is_disabled(model, "equality")


def has_joining_equalities(model: mujoco.MjModel) -> bool:
    """Return whether a model has equalities that no mocap body drives."""
    return has_equalities(model) and not is_mocap_driven(model).all()


def has_limits(model: mujoco.MjModel) -> bool:
    """Return whether joints or tendons of a model have limits."""
    return has_nonzero("jnt_limited", "tendon_limited")(model) and not is_disabled(model, "limit")


def has_friction_loss(model: mujoco.MjModel) -> bool:
    """Return whether joints or tendons of a model have friction loss."""
    return has_nonzero("dof_frictionloss", "tendon_frictionloss")(model) and not is_disabled(
        model, "frictionloss"
    )


def may_slip(model: mujoco.MjModel) -> bool:
    """Return whether noslip has anything to do; the engine refuses it for flexes."""
    return has_no_flex(model) and (has_condim_above(NO_FRICTION)(model) or has_friction_loss(model))


def has_constraints(model: mujoco.MjModel) -> bool:
    """Return whether a model has anything to solve."""
    others = (has_limits, has_equalities, has_friction_loss)
    return may_collide(model) or any(has(model) for has in others)


CONTACT_SOLREF_FIELDS = ("geom_solref", "pair_solref", "flex_solref")
"""Fields of solref of contacts. The override of the options is another."""
SOLREF_FIELDS = (
    *CONTACT_SOLREF_FIELDS,
    "jnt_solref",
    "dof_solref",
    "eq_solref",
    "tendon_solref_lim",
    "tendon_solref_fri",
)


def raises_time_constants(model: mujoco.MjModel) -> bool:
    """Return whether refsafe raises any time constant at a model's step."""
    if is_disabled(model, "refsafe"):
        return False
    return find_shortest_time_constant(model) < 2 * model.opt.timestep


def find_shortest_time_constant(model: mujoco.MjModel) -> float:
    """Return the shortest of a solref that anything may use [s]; infinite without one."""
    times = np.concatenate(
        [getattr(model, field)[find_used_rows(model, field), 0] for field in SOLREF_FIELDS]
    )
    return float(times.min(where=times > 0, initial=np.inf))


def find_used_rows(model: mujoco.MjModel, field: str) -> NDArray[np.bool_]:
    """Return which rows of a field of solref anything may use."""
    is_used = {
        "geom_solref": model.geom_contype | model.geom_conaffinity,
        "jnt_solref": model.jnt_limited,
        "dof_solref": model.dof_frictionloss,
        "tendon_solref_lim": model.tendon_limited,
        "tendon_solref_fri": model.tendon_frictionloss,
    }
    return np.asarray(is_used.get(field, np.ones(len(getattr(model, field))))) != 0


def may_sleep(model: mujoco.MjModel) -> bool:
    """Return whether some bodies could sleep, but may not in the model as written.

    Driven trees stay awake, and sleep of a single other tree saves little. MuJoCo has no sleep for
    equalities of tendons.
    """
    if (model.eq_type == int(mujoco.mjtEq.mjEQ_TENDON)).any():
        return False
    if "sleep" not in FLAG_NAMES or read_flag(model, "sleep"):
        return False
    allowed = (mujoco.mjtSleepPolicy.mjSLEEP_AUTO_ALLOWED, mujoco.mjtSleepPolicy.mjSLEEP_ALLOWED)
    return bool(np.isin(model.tree_sleep_policy, [int(each) for each in allowed]).any())


def has_possible_contacts(model: mujoco.MjModel) -> bool:
    """Return whether any contact is possible: of geoms, listed pairs or flexes."""
    return bool(filtered_pairs(model) or model.npair or model.nflex)


def lacks_surroundings(model: mujoco.MjModel) -> bool:
    """Return whether something falls in a model, and nothing is fixed that it could fall on.

    Its floor is in another file, so that geoms that touch nothing here touch it there.
    """
    solid = (model.geom_contype | model.geom_conaffinity) != 0
    if (model.body_weldid[model.geom_bodyid[solid]] == 0).any() or not has_gravity(model):
        return False
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    # Along a slide joint, half of gravity lets a body fall: 60 degrees from vertical.
    slides = (model.jnt_type == int(mujoco.mjtJoint.mjJNT_SLIDE)) & (
        np.abs(data.xaxis @ model.opt.gravity) > read_gravity(model) / 2
    )
    driven = model.actuator_trnid[model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT), 0]
    is_held = (model.jnt_limited != 0) | (model.jnt_stiffness != 0)
    is_held[driven] = True
    falls = (model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE)) | (slides & ~is_held)
    return bool(falls.any()) and bool(solid.any())


def has_flag(name: str) -> ModelPredicate:
    """Return whether a flag of this MuJoCo is on in a model."""
    return lambda model: name in FLAG_NAMES and read_flag(model, name)


def find_limited_joints(model: mujoco.MjModel) -> list[int]:
    """Return the ids of joints with limits."""
    return np.flatnonzero(model.jnt_limited).tolist()


def find_colliding_geoms(model: mujoco.MjModel) -> list[int]:
    """Return the ids of geoms with collision bits."""
    return np.flatnonzero(model.geom_contype | model.geom_conaffinity).tolist()
