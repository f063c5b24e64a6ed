"""A model's joints, for norms on its configurations, and starts that are hardly another."""

import mujoco
import numpy as np

from contactlab.contact import Joints
from contactlab.scene.starts import Starts

_JOINT = mujoco.mjtJoint
TWIN = 1e-8
"""How far a twin starts from its run [m, rad, m/s, rad/s]."""


def joints_of(model: mujoco.MjModel) -> Joints:
    """Return the joints of a model, with the lengths that MuJoCo gives their degrees of freedom."""
    kinds = np.asarray(model.jnt_type)
    places, dofs = np.asarray(model.jnt_qposadr), np.asarray(model.jnt_dofadr)
    scalar = (kinds == _JOINT.mjJNT_SLIDE) | (kinds == _JOINT.mjJNT_HINGE)
    free, ball = kinds == _JOINT.mjJNT_FREE, kinds == _JOINT.mjJNT_BALL
    turning = [*(dofs[free] + 3), *dofs[ball]]
    return Joints(
        scalars=tuple(places[scalar].tolist()),
        lengths=np.array(model.dof_length[dofs[scalar]]),
        points=tuple(places[free].tolist()),
        rotations=(*(places[free] + 3).tolist(), *places[ball].tolist()),
        reaches=np.array(model.dof_length[turning]) if turning else np.empty(0),
    )


def twin_of(start: Starts, joints: Joints, seed: int) -> Starts:
    """Return a start up to 1e-8 away in every place and velocity [m, rad, m/s, rad/s].

    Rotations stay as they are; their velocities tell them apart soon enough.
    """
    dice = np.random.default_rng([seed, 2])
    qpos, qvel = start.qpos.copy(), start.qvel.copy()
    places = [*joints.scalars, *(point + axis for point in joints.points for axis in range(3))]
    qpos[:, places] += TWIN * dice.uniform(-1, 1, len(places))
    qvel += TWIN * dice.uniform(-1, 1, qvel.shape[1])
    return start._replace(qpos=qpos, qvel=qvel)
