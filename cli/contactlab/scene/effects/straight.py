"""Whether a run starts without turning or moving sideways."""

import mujoco
import numpy as np

from contactlab.scene.initial_states import InitialStates


def is_straight(model: mujoco.MjModel, start: InitialStates) -> bool:
    """Say whether, at the start, nothing turns or moves but along z, nor is pushed otherwise.

    Args:
        model: the run's model.
        start: its start state, n being 1; what is driven over time counts as pushed.
    """
    free = np.asarray(model.jnt_dofadr)[model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE)]
    sideways = np.delete(start.qvel[0], free + 2)
    pushed = np.delete(start.applied[0].reshape(-1, 6), 2, axis=1)
    return not (sideways.any() or pushed.any() or start.driven.size)
