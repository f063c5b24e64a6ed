"""Holds a posture by an external load: springs and dampers between joints and the world.

No actuator is changed: each keeps its controls, its limits and its gains. The load acts on the
slides and hinges that actuators move. At the start it balances the other forces there,
    load = qfrc_bias - qfrc_passive - qfrc_actuator
and around the start it acts as springs: with M the inertia matrix and K the springs, no rate of
M^-1 K exceeds the square of 4 Hz, or of 12 Hz if legs carry a body, whatever the timestep of the
model. Dampers are critical. A spring k at rest at q0 that balances a force f is one at rest at
q0 + f / k, so springs and dampers of the joints themselves carry the load: they are added to those
of the run's model, and MuJoCo integrates them like any other.

A body standing on the ground carries more than gravity: the ground pushes back. So a robot without
an actuator at its root settles first, in a separate simulation, and the spring forces at its end
join the balance.
"""

import copy
from contextlib import suppress
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats

_SCALAR_JOINTS = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
_FREE_JOINT = int(mujoco.mjtJoint.mjJNT_FREE)


@dataclass(frozen=True)
class Load:
    """Springs and dampers on J slides and hinges, from outside of the model."""

    joints: NDArray[np.intp]  # (J,)
    stiffness: Floats  # (J,) [N m/rad or N/m]
    damping: Floats  # (J,) [N m s/rad or N s/m]
    places: Floats  # (J,) rest positions of the springs [rad or m]
    balance: Floats  # (J,) forces of the springs there [N m or N]

    def write_load(self, model: mujoco.MjModel) -> None:
        """Add them to the springs and dampers of a model's joints, in place."""
        dofs, places = model.jnt_dofadr[self.joints], model.jnt_qposadr[self.joints]
        own = np.array(model.jnt_stiffness[self.joints])
        whole = own + self.stiffness
        rest = own * model.qpos_spring[places] + self.stiffness * self.places + self.balance
        model.qpos_spring[places] = rest / whole
        model.jnt_stiffness[self.joints] = whole
        model.dof_damping[dofs] += self.damping


def find_load(model: mujoco.MjModel, qpos: Floats, ctrl: Floats, act: Floats) -> Load:
    """Return the load that holds qpos (nq,) of a model, or the nearest configuration within limits.

    Controls (nu,) and activations (na,) are those at the start. Joints with polynomial springs are
    excluded, because a load cannot be added to them.
    """
    data = mujoco.MjData(model)
    data.qpos[:], data.ctrl[:], data.act[:] = qpos, ctrl, act
    mujoco.mj_forward(model, data)
    moment = actuator_moments(model, data)
    moved = np.abs(moment).max(axis=0, initial=0) > 0
    scalar = np.isin(model.jnt_type, _SCALAR_JOINTS)
    curved = np.any(getattr(model, "jnt_stiffnesspoly", np.zeros((model.njnt, 1))), axis=1)
    joints = np.flatnonzero(scalar & ~curved & moved[model.jnt_dofadr])
    dofs, places = model.jnt_dofadr[joints], model.jnt_qposadr[joints]
    inertia = np.zeros((model.nv, model.nv))
    for column, unit in zip(inertia, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, column, unit)
    # Highest natural frequency of the springs [rad/s]: a few hertz; more if legs carry a body.
    hertz = 12 if _carried_bodies(model, moment).size else 4
    frequency = 2 * np.pi * hertz
    compliance = np.abs(np.linalg.inv(inertia)[np.ix_(dofs, dofs)])
    # Coefficients c such that no rate of M^-1 c exceeds 1. By Gershgorin's theorem a rate is at
    # most the largest row sum of |M^-1 c|, in any units; here M^-1 has ones on its diagonal.
    units = np.sqrt(np.diagonal(compliance))
    stiffness = frequency**2 * (
        1 / np.maximum((compliance / units).sum(axis=1) * units, np.finfo(float).tiny)
    )
    # In these units, a joint moves the inertia on the diagonal of M.
    damping = 2 * np.sqrt(stiffness * np.diagonal(inertia)[dofs])
    start_positions = np.array(qpos[places])
    limited = np.asarray(model.jnt_limited)[joints].astype(bool)
    within = np.clip(start_positions, *np.asarray(model.jnt_range)[joints].T)
    forces = np.asarray(data.qfrc_bias - data.qfrc_passive - data.qfrc_actuator)[dofs]
    load = Load(joints, stiffness, damping, np.where(limited, within, start_positions), forces)
    if not _carried_bodies(model, moment).size:
        return load
    # The load also balances the reaction of the ground. Each round settles with the spring forces
    # at the end of the previous one, as long as that brings the joints closer to their positions.
    best_load, least = load, np.inf
    max_rounds, accepted_distance = 10, 0.01  # the distance to the posture [rad or m]
    for _ in range(max_rounds):
        held_model = copy.copy(model)
        # With a fixed timestep [s] the load is the same for every timestep of the model.
        held_model.opt.timestep = 2e-3
        load.write_load(held_model)
        away = _settled_distance(held_model, load, data)
        if not np.abs(away).max(initial=0.0) < least:
            break
        best_load, least = load, float(np.abs(away).max(initial=0.0))
        if least < accepted_distance:
            break
        load = replace(load, balance=load.balance - load.stiffness * away)
    return best_load


def _settled_distance(model: mujoco.MjModel, load: Load, start: mujoco.MjData) -> Floats:
    """Return (J,) the distance of joints from their positions at rest; NaN for a divergence.

    For a robot that still moves at the time limit, it is the mean over the second half of the time.
    """
    data, looks = mujoco.MjData(model), list[Floats]()
    data.qpos[:], data.ctrl[:], data.act[:] = start.qpos, start.ctrl, start.act
    # A robot has settled below this speed [rad/s, m/s]; interval and limit of the checks [s].
    settled_speed, check_interval_s, max_settling_s = 0.02, 0.05, 1.0
    steps = max(1, round(check_interval_s / model.opt.timestep))
    places = model.jnt_qposadr[load.joints]
    while data.time < max_settling_s:
        with suppress(mujoco.FatalError):
            mujoco.mj_step(model, data, nstep=steps)
        if data.warning.number.any() or not data.time > len(looks) * steps * model.opt.timestep:
            return np.full(len(places), np.nan)
        looks.append(data.qpos[places] - load.places)
        if np.abs(data.qvel).max(initial=0.0) < settled_speed:
            return looks[-1]
    return np.mean(looks[len(looks) // 2 :], axis=0)


def unheld_text(model: mujoco.MjModel, qpos: Floats, load: Load) -> str:
    """Return the joints and bodies of a start qpos (nq,) that a load does not hold.

    It is empty if the load holds everything. Free bodies do not count.
    """
    jointed = np.flatnonzero(np.asarray(model.jnt_type) != _FREE_JOINT)
    beyond = np.abs(load.places - qpos[model.jnt_qposadr[load.joints]])
    # Bodies that a weld or a connect fixes to a mocap body.
    kinds = int(mujoco.mjtEq.mjEQ_WELD), int(mujoco.mjtEq.mjEQ_CONNECT)
    chosen = np.isin(model.eq_type, kinds) & np.asarray(model.eq_active0).astype(bool)
    sides = np.stack([model.eq_obj1id, model.eq_obj2id], axis=1)[chosen]
    sites = np.asarray(model.eq_objtype)[chosen] == int(mujoco.mjtObj.mjOBJ_SITE)
    if sites.any():
        sides[sites] = np.asarray(model.site_bodyid)[sides[sites]]
    moved = np.asarray(model.body_mocapid)[sides] >= 0
    parts = (
        ("no actuator moves", model.joint, np.setdiff1d(jointed, load.joints)),
        (
            "fixed to a mocap body:",
            model.body,
            np.unique(sides[~moved & moved.any(axis=1, keepdims=True)]),
        ),
        (
            f"up to {beyond.max(initial=0):.2g} beyond their limits at the start:",
            model.joint,
            # Smallest excess of a start over a limit that is reported [rad or m].
            load.joints[beyond > 1e-3],
        ),
    )
    problems: list[str] = []
    for problem, element, ids in parts:
        names = [str(element(index).name) for index in ids.tolist()]
        more = [f"{len(names) - 4} more"] if len(names) > 4 else []
        problems += [f"{problem} {', '.join(names[:4] + more)}"] if names else []
    return "; ".join(problems)


def actuator_moments(model: mujoco.MjModel, data: mujoco.MjData) -> Floats:
    """Return (nu, nv) the derivatives of actuator lengths with respect to joints."""
    moment = np.zeros((model.nu, model.nv))
    rows = data.moment_rownnz, data.moment_rowadr
    values, columns = data.actuator_moment.ravel(), data.moment_colind.ravel()
    mujoco.mju_sparse2dense(moment, values, *rows, columns)
    return moment


def _carried_bodies(model: mujoco.MjModel, moment: Floats) -> NDArray[np.int32]:
    """Return the bodies of unactuated joints that carry actuated ones."""
    moved = np.abs(moment).max(axis=0, initial=0) > 0
    above = np.asarray(model.dof_parentid)[moved]
    above = above[above >= 0]
    return np.asarray(model.dof_bodyid)[above[~moved[above]]]
