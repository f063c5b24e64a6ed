"""Joints of a model and what drives them, as the adapters of engines without such take it."""

from typing import Any

import mujoco
import numpy as np

FREE, BALL, SLIDE, HINGE = (
    int(getattr(mujoco.mjtJoint, f"mjJNT_{name}")) for name in ("FREE", "BALL", "SLIDE", "HINGE")
)
OFF = mujoco.mjtDisableBit
_DRIVES = (
    "it drives hinges and slides by motors and servos without dynamics of their own, and limits "
    "forces of actuators, not of joints"
)


def refusals(model: mujoco.MjModel, limits: bool = False) -> list[tuple[Any, str]]:
    """Return what is left out of joints and of what drives them, with whether a model needs it.

    Limits are among it unless the engine knows them.
    """
    disabled, scalar = model.opt.disableflags, np.isin(model.jnt_type, (SLIDE, HINGE))
    off = OFF.mjDSBL_CONSTRAINT
    simple = (
        (model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT))
        & (model.actuator_dyntype == int(mujoco.mjtDyn.mjDYN_NONE))
        & (model.actuator_gaintype == int(mujoco.mjtGain.mjGAIN_FIXED))
        & (model.actuator_biastype <= int(mujoco.mjtBias.mjBIAS_AFFINE))
    )
    driven = model.actuator_trnid[simple, 0]
    return [
        (
            not limits and not disabled & (OFF.mjDSBL_LIMIT | off) and model.jnt_limited.any(),
            "it knows no limits of joints here; set limit to false",
        ),
        (
            model.ntendon or model.nflex or model.nplugin or (model.neq and not disabled & off),
            "it knows no equalities, tendons, flexes and plug-ins; take a model without them",
        ),
        (
            model.opt.density or model.opt.viscosity or model.body_gravcomp.any(),
            "it knows no medium and no compensation of gravity",
        ),
        (
            not disabled & OFF.mjDSBL_SPRING and model.jnt_stiffness[~scalar].any(),
            "its springs are of hinges and slides; set stiffness of free and ball joints to 0",
        ),
        (
            not disabled & OFF.mjDSBL_ACTUATION
            and not (simple.all() and scalar[driven].all() and not model.jnt_actfrclimited.any()),
            _DRIVES,
        ),
    ]


def gravity_of(model: mujoco.MjModel) -> np.ndarray:
    """Return (3,) the gravity that acts [m/s^2]."""
    return np.array(model.opt.gravity) * (not model.opt.disableflags & OFF.mjDSBL_GRAVITY)


def joint_forces(
    model: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray, control: np.ndarray
) -> np.ndarray:
    """Return (nv,) forces of springs and actuators."""
    forces = np.zeros(model.nv)
    scalar = np.flatnonzero((model.jnt_type != FREE) & (model.jnt_type != BALL))
    places, dofs = model.jnt_qposadr[scalar], model.jnt_dofadr[scalar]
    if not model.opt.disableflags & OFF.mjDSBL_SPRING:
        forces[dofs] -= model.jnt_stiffness[scalar] * (qpos[places] - model.qpos_spring[places])
    if model.opt.disableflags & OFF.mjDSBL_ACTUATION:
        return forces
    for actuator in range(model.nu):
        joint, gear = model.actuator_trnid[actuator, 0], model.actuator_gear[actuator, 0]
        place, dof = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
        given = control[actuator]
        if model.actuator_ctrllimited[actuator]:
            given = np.clip(given, *model.actuator_ctrlrange[actuator])
        bias = model.actuator_biasprm[actuator, :3] @ [1, gear * qpos[place], gear * qvel[dof]]
        affine = model.actuator_biastype[actuator] == int(mujoco.mjtBias.mjBIAS_AFFINE)
        force = model.actuator_gainprm[actuator, 0] * given + affine * bias
        if model.actuator_forcelimited[actuator]:
            force = np.clip(force, *model.actuator_forcerange[actuator])
        forces[dof] += gear * force
    return forces
