"""Energy and momenta of recorded states."""

import mujoco
import numpy as np

from contactlab.contact import Floats, Invariants

_LIFT = 1e-3


def invariants(model: mujoco.MjModel, qpos: Floats, qvel: Floats, *, free: bool) -> Invariants:
    """Return what a passive model conserves, at T states.

    Args:
        model: the model.
        qpos: (T, nq) configurations.
        qvel: (T, nv) velocities.
        free: whether nothing from outside acts on it, so that momenta are conserved as well.
    """
    data = mujoco.MjData(model)
    rows = np.array([_row(model, data, *each) for each in zip(qpos, qvel, strict=True)])
    mass = float(model.body_subtreemass[0])
    gravity = float(np.linalg.norm(model.opt.gravity))
    off = model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY
    conserved = free and (off or not gravity)
    return Invariants(
        energy=rows[:, 0] + rows[:, 1],
        kinetic=rows[:, 1],
        momentum=mass * rows[:, 2:5] if conserved else None,
        angular_momentum=rows[:, 5:8] if conserved else None,
        mass=mass,
        lift=0.0 if off else mass * gravity * _LIFT,
    )


def _row(model: mujoco.MjModel, data: mujoco.MjData, qpos: Floats, qvel: Floats) -> Floats:
    """Return (8,) potential and kinetic energy, velocity of the centre of mass, and spin."""
    data.qpos[:], data.qvel[:] = qpos, qvel
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    mujoco.mj_energyPos(model, data)
    mujoco.mj_energyVel(model, data)
    mujoco.mj_subtreeVel(model, data)
    return np.concatenate([data.energy, data.subtree_linvel[0], data.subtree_angmom[0]])
