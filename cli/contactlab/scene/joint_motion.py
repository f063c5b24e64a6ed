"""Motion of joints at the start of a run, in directions drawn by its seed."""

from collections.abc import Sequence

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.scene.initial_states import InitialStates
from contactlab.scene.resolution import ResolvedRun

_FREE_DOFS = 6
_JOINT = mujoco.mjtJoint


def start_joints(
    model: mujoco.MjModel, starts: InitialStates, runs: Sequence[ResolvedRun]
) -> InitialStates:
    """Return initial states of some runs with their joints in motion, if these ask for it."""
    if not any(run.joint_speed for run in runs):
        return starts
    added = [run.joint_speed * joint_directions(model, run.seed) for run in runs]
    return starts._replace(qvel=starts.qvel + added)


def joint_directions(model: mujoco.MjModel, seed: int) -> Floats:
    """Return (nv,) the velocities of joints at unit speed, each either way.

    A hinge turns at 1 rad/s, a ball joint too, about a random axis, and so does a free body that
    carries no joints; the base of others is at rest. A slide moves as fast as the tip of a body of
    the model's mean size would at 1 rad/s.
    """
    generator = np.random.default_rng([seed, 3])
    velocity = np.zeros(model.nv)
    for kind, dof in zip(model.jnt_type, model.jnt_dofadr, strict=True):
        axis = generator.normal(size=3)
        axis /= np.linalg.norm(axis)
        if kind == _JOINT.mjJNT_FREE:
            alone = model.tree_dofnum[model.dof_treeid[dof]] == _FREE_DOFS
            velocity[dof + 3 : dof + 6] = axis * alone
        elif kind == _JOINT.mjJNT_BALL:
            velocity[dof : dof + 3] = axis
        else:
            length = model.stat.meansize if kind == _JOINT.mjJNT_SLIDE else 1.0
            velocity[dof] = np.copysign(length, axis[0])
    return velocity
