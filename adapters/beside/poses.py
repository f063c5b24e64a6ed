"""Places of bodies (position, quaternion) and their velocities, as MuJoCo has them."""

from typing import Any

import mujoco
import numpy as np

STRAIGHT = np.array([1.0, 0, 0, 0])
IDENTITY = (np.zeros(3), STRAIGHT)


def then(first: Any, second: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return a place that is given in the frame of another."""
    turn = np.zeros(4)
    mujoco.mju_mulQuat(turn, first[1], second[1])
    return first[0] + turned(first[1], second[0]), turn


def inverse(place: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the place of the frame in which a place is given, in that of the place."""
    back = place[1] * [1, -1, -1, -1]
    return -turned(back, place[0]), back


def turned(turn: np.ndarray, vector: Any) -> np.ndarray:
    """Return a vector (3,) turned by a quaternion."""
    told = np.zeros(3)
    mujoco.mju_rotVecQuat(told, np.array(vector, dtype=float), turn)
    return told


def at_centre(
    model: mujoco.MjModel, body: int, turn: np.ndarray, qvel: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return velocity of a free body's centre of mass and its spin, in the world, of its qvel."""
    spin = turned(turn, qvel[3:6])
    return qvel[:3] + np.cross(spin, turned(turn, model.body_ipos[body])), spin


def at_origin(model: mujoco.MjModel, body: int, turn: np.ndarray, moving: Any) -> np.ndarray:
    """Return the qvel (6,) of a free body, of what `at_centre` returns."""
    linear, spin = (np.array(each, dtype=float) for each in moving)
    own = linear - np.cross(spin, turned(turn, model.body_ipos[body]))
    return np.concatenate([own, turned(turn * [1, -1, -1, -1], spin)])


def away_from_zero(model: mujoco.MjModel) -> mujoco.MjData:
    """Return a state in which all joints are away from where they have their zero."""
    data = mujoco.MjData(model)
    mujoco.mj_integratePos(model, data.qpos, 0.5 * np.sin(1 + np.arange(model.nv)), 1.0)
    data.qvel[:] = np.cos(np.arange(model.nv))
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return data
