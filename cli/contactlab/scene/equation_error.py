"""The residual of the equation of motion at one state."""

import mujoco
import numpy as np


def measure_equation_error(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Return the residual of M a = f + J^T f_c(J a - a_ref) over its largest force.

    It uses no factorization and no result of a solver except the acceleration.
    """
    mass, relative = np.zeros((model.nv, model.nv)), np.zeros(data.nefc)
    mujoco.mj_fullM(model, data, mass)
    acceleration = data.qacc.copy()
    mujoco.mj_mulJacVec(model, data, relative, acceleration)
    mujoco.mj_constraintUpdate(model, data, relative - data.efc_aref, None, False)
    parts = mass @ acceleration, data.qfrc_smooth, data.qfrc_constraint
    size = max(np.abs(parts).max(initial=0), np.finfo(float).tiny)
    return float(np.abs(parts[0] - parts[1] - parts[2]).max(initial=0) / size)
