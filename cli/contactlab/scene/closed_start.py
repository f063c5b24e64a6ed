"""Finds the nearest start that a model's equalities, limits and contacts allow.

Constraints that are open at the start are closed by force: the farther they are open and the
stiffer they are, the harder bodies are flung. The correction to the allowed start is the one of
least kinetic energy: rows with residual r and Jacobian J move positions by
M^-1 J^T (J M^-1 J^T)^+ (-r), repeated as in Newton-Raphson iteration.
"""

import copy
import math

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.numerical_tolerance import SUM_ROUNDING

OPEN_TOLERANCE = 0.01
"""A constraint violated by more is open: share of the extent of the moving geoms, or radians."""
_DENSE_JACOBIAN = int(mujoco.mjtJacobian.mjJAC_DENSE)
_EQUALITY_ROW = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
_LIMIT_ROW = int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT)
_JOINT_TYPES = int(mujoco.mjtEq.mjEQ_JOINT)
_ROTATIONAL_JOINTS = [int(mujoco.mjtJoint.mjJNT_BALL), int(mujoco.mjtJoint.mjJNT_HINGE)]


def closed_start(model: mujoco.MjModel, start: Floats, spec: int) -> Floats | None:
    """Return the (nq,) positions of the nearest start without an open constraint.

    `spec` lists the state elements in `start`. The result is None if nothing is open in `start`, or
    if no nearby start closes everything.
    """
    # Rows only for equalities and limits, and one for each contact.
    frictionless = copy.copy(model)
    frictionless.opt.jacobian = _DENSE_JACOBIAN
    frictionless.geom_condim[:] = frictionless.pair_dim[:] = 1
    frictionless.dof_frictionloss[:] = frictionless.tendon_frictionloss[:] = 0
    data = mujoco.MjData(frictionless)
    mujoco.mj_setState(frictionless, data, start, spec)
    apart, sizes = _row_violations(frictionless, data)
    if float(np.abs(apart / sizes).max(initial=0)) <= OPEN_TOLERANCE:
        return None
    max_iterations, max_open_rows = 30, 300  # keep the search below one second
    for _ in range(max_iterations):
        apart, sizes = _row_violations(frictionless, data)
        # A constraint violated by less is closed: share of that extent, or radians.
        if np.abs(apart / sizes).max(initial=0) <= 1e-6:
            return data.qpos.copy()
        if np.count_nonzero(apart) > max_open_rows:
            return None
        jacobian = data.efc_J.reshape(data.nefc, model.nv)[apart != 0]
        moved = np.zeros_like(jacobian)
        mujoco.mj_solveM(frictionless, data, moved, jacobian)
        weights = np.linalg.pinv(jacobian @ moved.T, rcond=SUM_ROUNDING, hermitian=True)
        step = -moved.T @ (weights @ apart[apart != 0])
        if not np.abs(step).max() <= max(math.pi, moving_extent(frictionless, data)):
            return None  # too large a step, or NaN
        mujoco.mj_integratePos(frictionless, data.qpos, step, 1)
    return None


def _row_violations(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[Floats, Floats]:
    """Return how far each row is violated (nefc,), 0 if it is not, and the scale of each row.

    The scale is the extent of the moving geoms, or one radian.
    """
    mujoco.mj_fwdPosition(model, data)
    kinds, ids = data.efc_type, data.efc_id
    apart = np.where(kinds == _EQUALITY_ROW, data.efc_pos, np.minimum(data.efc_pos, 0))
    turns = np.isin(model.jnt_type, _ROTATIONAL_JOINTS)
    angles = np.zeros(len(kinds), bool)
    angles[kinds == _LIMIT_ROW] = turns[ids[kinds == _LIMIT_ROW]]
    joined = kinds == _EQUALITY_ROW
    joined[joined] = model.eq_type[ids[joined]] == _JOINT_TYPES
    angles[joined] = turns[model.eq_obj1id[ids[joined]]]
    return apart, np.where(angles, 1.0, moving_extent(model, data))


def moving_extent(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Return the longest side of the box around all geoms that move [m].

    The static geoms around them may be a thousand times larger. The result is at most the model's
    extent, and equals it if no geom moves.
    """
    moves = (model.body_weldid[model.geom_bodyid] > 0) & (model.geom_rbound > 0)
    places, radii = data.geom_xpos[moves], model.geom_rbound[moves, None]
    if not len(places):
        return float(model.stat.extent)
    sides = (places + radii).max(axis=0) - (places - radii).min(axis=0)
    return min(float(model.stat.extent), float(sides.max()))
