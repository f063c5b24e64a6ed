"""The energy of single free bodies, which a mechanism beside them does not share."""

from collections.abc import Sequence

import mujoco
import numpy as np

from contactlab.contact import Floats, rotation_matrices

_FREE_DOFS = 6


def single_free_bodies(model: mujoco.MjModel) -> tuple[int, ...]:
    """Return the bodies on a free joint that carry no other moving body."""
    joints = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    trees = model.dof_treeid[model.jnt_dofadr[joints]]
    alone = model.tree_dofnum[trees] == _FREE_DOFS
    return tuple(model.jnt_bodyid[joints[alone]].tolist())


def free_body_energy(
    model: mujoco.MjModel, bodies: Sequence[int], qpos: Floats, qvel: Floats
) -> tuple[Floats, Floats]:
    """Return the kinetic and the potential energy of some single free bodies [J], (N,) each.

    Kinetic energy is v' M v / 2 with the body's 6 x 6 inertia M and its velocity v along its own
    axes, where M does not change with the pose.

    Args:
        model: the run's model.
        bodies: single free bodies.
        qpos: (N, nq) configurations.
        qvel: (N, nv) velocities.
    """
    kinetic, potential = np.zeros(len(qpos)), np.zeros(len(qpos))
    for body in bodies:
        joint = int(model.body_jntadr[body])
        place, dof = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
        inertia = _inertia(model, place, dof)
        turn = rotation_matrices(qpos[:, place + 3 : place + 7])
        velocity = qvel[:, dof : dof + 6].copy()
        velocity[:, :3] = np.einsum("nji,nj->ni", turn, velocity[:, :3])
        kinetic += 0.5 * np.einsum("ni,ij,nj->n", velocity, inertia, velocity)
        mass = float(model.body_subtreemass[body])
        centre = qpos[:, place : place + 3] + turn @ (_moment(inertia) / mass)
        potential -= mass * (centre @ np.asarray(model.opt.gravity))
    return kinetic, potential


def _inertia(model: mujoco.MjModel, place: int, dof: int) -> Floats:
    """Return the 6 x 6 inertia of a free joint along its body's axes: linear, then angular."""
    data = mujoco.MjData(model)
    data.qpos[place : place + 7] = [0, 0, 0, 1, 0, 0, 0]
    mujoco.mj_forward(model, data)
    columns = np.zeros((_FREE_DOFS, model.nv))
    units = np.zeros((_FREE_DOFS, model.nv))
    units[np.arange(_FREE_DOFS), dof + np.arange(_FREE_DOFS)] = 1
    for column, unit in zip(columns, units, strict=True):
        mujoco.mj_mulM(model, data, column, unit)
    return columns[:, dof : dof + _FREE_DOFS]


def _moment(inertia: Floats) -> Floats:
    """Return mass times centre of mass [kg m], which couples linear and angular velocity."""
    return np.array([inertia[1, 5], inertia[2, 3], inertia[0, 4]])
