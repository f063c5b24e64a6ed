"""Predicates on states after a step: whether the state loads the setting of a modification."""

from collections.abc import Iterator

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.modifications.model_predicates import CLAMP_FLAG, is_disabled
from contactlab.modifications.modification import StatePredicate
from contactlab.numerical_tolerance import COARSE_ROUNDING
from contactlab.scene.part_bodies import is_mocap_driven


def has_constraint_force(*kinds: str) -> StatePredicate:
    """Return whether constraints of some kinds push."""
    constraint_types = [int(getattr(mujoco.mjtConstraint, f"mjCNSTR_{kind}")) for kind in kinds]

    def is_loaded(model: mujoco.MjModel, data: mujoco.MjData) -> bool:  # noqa: ARG001
        if not data.nefc:
            return False
        force = np.abs(data.efc_force)
        own = force[np.isin(data.efc_type, constraint_types)].max(initial=0)
        return bool(own > COARSE_ROUNDING * force.max())

    return is_loaded


has_contact_force = has_constraint_force(
    "CONTACT_FRICTIONLESS", "CONTACT_PYRAMIDAL", "CONTACT_ELLIPTIC"
)


has_limit_force = has_constraint_force("LIMIT_JOINT", "LIMIT_TENDON")


has_friction_loss_force = has_constraint_force("FRICTION_DOF", "FRICTION_TENDON")


has_equality_force = has_constraint_force("EQUALITY")


def has_force(field: str) -> StatePredicate:
    """Return whether a field of generalized forces has any that is more than rounding."""

    def is_loaded(model: mujoco.MjModel, data: mujoco.MjData) -> bool:  # noqa: ARG001
        others = max(
            np.abs(data.qfrc_bias).max(initial=0), np.abs(data.qfrc_passive).max(initial=0)
        )
        own = np.abs(getattr(data, field)).max(initial=0)
        return bool(own > COARSE_ROUNDING * others)

    return is_loaded


def _contact_forces(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[tuple[int, Floats]]:
    force = np.empty(6)
    for contact in np.flatnonzero(data.contact.efc_address >= 0):
        mujoco.mj_contactForce(model, data, int(contact), force)
        yield int(contact), force


def has_contact_direction(first: int, last: int) -> StatePredicate:
    """Return whether a contact pushes in some of its directions other than the normal, 0."""

    def is_loaded(model: mujoco.MjModel, data: mujoco.MjData) -> bool:
        return any(
            np.abs(force[first:last]).max() > COARSE_ROUNDING * abs(force[0])
            for _, force in _contact_forces(model, data)
        )

    return is_loaded


has_friction = has_contact_direction(1, 3)


has_torsional_friction = has_contact_direction(3, 6)


def has_any_friction(model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    """Return whether friction acts in a contact, a joint or a tendon."""
    return has_friction_loss_force(model, data) or has_friction(model, data)


def pushes_at_distance(model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    """Return whether a contact pushes geoms that do not touch, or does only by its margin."""
    return any(
        data.contact.dist[contact] > 0 and force[0] > 0
        for contact, force in _contact_forces(model, data)
    )


def loads_raised_constant(model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    """Return whether a constraint with a time constant that refsafe raises pushes."""
    least = 2 * model.opt.timestep
    if any(
        0 < data.contact.solref[contact][0] < least and force[0] > 0
        for contact, force in _contact_forces(model, data)
    ):
        return True
    others = (
        (has_limit_force, ("jnt_solref", "tendon_solref_lim")),
        (has_friction_loss_force, ("dof_solref", "tendon_solref_fri")),
        (has_equality_force, ("eq_solref",)),
    )
    return any(
        ((getattr(model, field)[:, 0] > 0) & (getattr(model, field)[:, 0] < least)).any()
        and has_own_force(model, data)
        for has_own_force, fields in others
        for field in fields
    )


def has_constraint(model: mujoco.MjModel, data: mujoco.MjData) -> bool:  # noqa: ARG001
    """Return whether a state has any constraint."""
    return data.nefc > 0


def joins_bodies(model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    """Return whether an equality pushes that no mocap body drives."""
    rows = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    rows[rows] = ~is_mocap_driven(model)[data.efc_id[rows]]
    force = np.abs(data.efc_force)
    return bool(force[rows].max(initial=0) > COARSE_ROUNDING * force.max(initial=0))


def is_clamped(model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    """Return whether a control or a force is at its limit."""
    if not is_disabled(model, CLAMP_FLAG):
        low, high = model.actuator_ctrlrange.T
        beyond = (data.ctrl < low) | (data.ctrl > high)
        if (beyond & (model.actuator_ctrllimited > 0)).any():
            return True
    # Since MuJoCo 4, an actuator may have several outputs.
    outputs = getattr(model, "actuator_outnum", np.ones(len(model.actuator_forcelimited), int))
    low, high = model.actuator_forcerange.repeat(outputs, axis=0).T
    at = (data.actuator_force <= low) | (data.actuator_force >= high)
    if (at & (model.actuator_forcelimited.repeat(outputs) > 0)).any():
        return True
    # The actuators of a joint or tendon push with all that it allows.
    limited = np.flatnonzero(model.jnt_actfrclimited)
    force = data.qfrc_actuator[model.jnt_dofadr[limited]]
    low, high = model.jnt_actfrcrange[limited].T * (1 - COARSE_ROUNDING)
    # MuJoCo scales the actuators of a tendon together; their sum is then at the range.
    joints = ((force <= low) | (force >= high)).any()
    return bool(joints or model.tendon_actfrclimited.any())


def has_tendon_force(model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    """Return whether a tendon's spring, damper, limit or friction acts."""
    if has_constraint_force("LIMIT_TENDON", "FRICTION_TENDON")(model, data):
        return True
    low, high = model.tendon_lengthspring.T
    stretched = (data.ten_length < low) | (data.ten_length > high)
    springs = stretched & (model.tendon_stiffness != 0)
    return bool(springs.any() or ((model.tendon_damping != 0) & (data.ten_velocity != 0)).any())


def has_sleeping_tree(model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    """Return whether a tree of bodies sleeps."""
    return int(data.ntree_awake) < model.ntree
