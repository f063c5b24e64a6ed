"""The start that a model's equalities, limits and contacts allow, nearest to one that they do not.

What is open at the start is closed by force: as far as it is apart and as stiff as its constraint
is, bodies are flung. The way to the allowed start is the one of least kinetic energy: rows with
residual r and Jacobian J move positions by M^-1 J^T (J M^-1 J^T)^+ (-r), again and again, as Newton
and Raphson do.
"""

import copy
import math

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats

OPEN = 0.01
"""Share of the extent of what moves, or radians, from which a constraint is open."""
_ROUNDS, _MOST_ROWS = 30, 300  # so that it takes less than a second
_CLOSED = 1e-6  # share of that extent, or radians, below which it is closed
_SINGULAR = 1e-9  # of rows that say the same
_DENSE = int(mujoco.mjtJacobian.mjJAC_DENSE)
_EQUALITY = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
_LIMIT = int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT)
_JOINT = int(mujoco.mjtEq.mjEQ_JOINT)
_TURNING = [int(mujoco.mjtJoint.mjJNT_BALL), int(mujoco.mjtJoint.mjJNT_HINGE)]


def closed_start(model: mujoco.MjModel, start: Floats, spec: int) -> Floats | None:
    """Return the (nq,) positions of the nearest start at which nothing is open.

    `start` is a state that `spec` says the elements of. None where nothing is, or where no start
    near it closes all.
    """
    frictionless = _without_friction(model)
    data = mujoco.MjData(frictionless)
    mujoco.mj_setState(frictionless, data, start, spec)
    if _opened(frictionless, data) <= OPEN:
        return None
    for _ in range(_ROUNDS):
        apart, sizes = _violations(frictionless, data)
        if np.abs(apart / sizes).max(initial=0) <= _CLOSED:
            return data.qpos.copy()
        if np.count_nonzero(apart) > _MOST_ROWS:
            return None
        jacobian = data.efc_J.reshape(data.nefc, model.nv)[apart != 0]
        moved = np.zeros_like(jacobian)
        mujoco.mj_solveM(frictionless, data, moved, jacobian)
        weights = np.linalg.pinv(jacobian @ moved.T, rcond=_SINGULAR, hermitian=True)
        step = -moved.T @ (weights @ apart[apart != 0])
        if not np.abs(step).max() <= max(math.pi, moving_extent(frictionless, data)):
            return None  # nor a number
        mujoco.mj_integratePos(frictionless, data.qpos, step, 1)
    return None


def _without_friction(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return a copy whose rows are equalities, limits, and one for each contact."""
    made = copy.copy(model)
    made.opt.jacobian = _DENSE
    made.geom_condim[:] = made.pair_dim[:] = 1
    made.dof_frictionloss[:] = made.tendon_frictionloss[:] = 0
    return made


def _opened(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    apart, sizes = _violations(model, data)
    return float(np.abs(apart / sizes).max(initial=0))


def _violations(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[Floats, Floats]:
    """Return how far each row is violated (nefc,), 0 where it is not, and what is large for it.

    That is the extent of what moves, or a radian.
    """
    mujoco.mj_fwdPosition(model, data)
    kinds, ids = data.efc_type, data.efc_id
    apart = np.where(kinds == _EQUALITY, data.efc_pos, np.minimum(data.efc_pos, 0))
    turns = np.isin(model.jnt_type, _TURNING)
    angles = np.zeros(len(kinds), bool)
    angles[kinds == _LIMIT] = turns[ids[kinds == _LIMIT]]
    joined = kinds == _EQUALITY
    joined[joined] = model.eq_type[ids[joined]] == _JOINT
    angles[joined] = turns[model.eq_obj1id[ids[joined]]]
    return apart, np.where(angles, 1.0, moving_extent(model, data))


def moving_extent(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Return the longest side of the box around all geoms that move [m].

    The hall around them may be a thousand times as large. At most it is the model's extent, as it
    is where no geom moves.
    """
    moves = (model.body_weldid[model.geom_bodyid] > 0) & (model.geom_rbound > 0)
    places, radii = data.geom_xpos[moves], model.geom_rbound[moves, None]
    if not len(places):
        return float(model.stat.extent)
    sides = (places + radii).max(axis=0) - (places - radii).min(axis=0)
    return min(float(model.stat.extent), float(sides.max()))
