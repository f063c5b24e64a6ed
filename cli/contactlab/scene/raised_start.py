"""Raises roots that begin in the floor: a start that is too low keeps its posture.

Each floating robot is moved against gravity by its own overlap, until nothing of it overlaps a
fixed geom. Only its free joint, or the slide at its root, changes.
"""

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.scene.closed_start import OPEN_TOLERANCE, moving_extent

_FREE, _SLIDE = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_SLIDE)


def raised_start(model: mujoco.MjModel, start: Floats, spec: int) -> Floats | None:
    """Return the (nq,) positions of a start with its roots raised out of the floor.

    `spec` lists the state elements in `start`. The height of a root is rounded up to five digits.
    Returns None if nothing overlaps deeply, or if something still does after the raise.
    """
    gravity = np.array(model.opt.gravity)
    size = float(np.linalg.norm(gravity))
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, start, spec)
    mujoco.mj_fwdPosition(model, data)
    allowed = OPEN_TOLERANCE * moving_extent(model, data)
    if not size or deepest_overlap(data) <= allowed:
        return None
    up = -gravity / size
    most_rounds = 20  # the deepest contact of a round may hide others, such as those of stairs
    for _ in range(most_rounds):
        heights = _missing_heights(model, data, up)
        if not heights:
            return None if deepest_overlap(data) > allowed else data.qpos.copy()
        for joint, height in heights.items():
            lift, place = height * up, int(model.jnt_qposadr[joint])
            if int(model.jnt_type[joint]) == _FREE:
                for axis in np.flatnonzero(np.abs(lift) > 1e-9 * np.abs(lift).max()).tolist():
                    at = place + axis
                    data.qpos[at] = _round_away(data.qpos[at], float(lift[axis]))
            else:
                along = np.array(model.jnt_axis[joint])
                pose = np.array(model.body_quat[int(model.jnt_bodyid[joint])])
                mujoco.mju_rotVecQuat(along, along.copy(), pose)
                data.qpos[place] = _round_away(data.qpos[place], float(along @ lift))
        mujoco.mj_fwdPosition(model, data)
    return None


def _missing_heights(model: mujoco.MjModel, data: mujoco.MjData, up: Floats) -> dict[int, float]:
    # [m], by the joint that raises a root.
    heights = dict[int, float]()
    steep = 0.1  # of the unit normal along gravity: a steeper contact is a wall, not a floor
    rounding = 1e-9  # m, of sums of positions: less is a touch
    for place in np.flatnonzero(data.contact.dist < -rounding).tolist():
        geoms = data.contact.geom[place]
        bodies = model.geom_bodyid[geoms]
        fixed = model.body_weldid[bodies] == 0
        # A contact of a flex has geom -1.
        if geoms.min() < 0 or fixed.sum() != 1:
            continue
        # The normal points from the first geom to the second.
        normal = data.contact.frame[place, :3] * (1 if fixed[0] else -1)
        slope, joint = float(normal @ up), _root_joint(model, int(bodies[~fixed][0]), up)
        if joint >= 0 and slope >= steep:
            height = -float(data.contact.dist[place]) / slope
            heights[joint] = max(heights.get(joint, 0.0), height)
    return heights


def deepest_overlap(data: mujoco.MjData) -> float:
    """Return how deep the deepest contact is [m]; 0 if nothing overlaps."""
    return float(max(-data.contact.dist.min(initial=0.0), 0.0))


def _root_joint(model: mujoco.MjModel, body: int, up: Floats) -> int:
    # A free joint, or a slide along gravity; -1 if the root has neither.
    root = int(model.body_rootid[body])
    first = int(model.body_jntadr[root])
    aligned = 1 - 1e-6  # cosine of a slide along gravity
    for joint in range(first, first + int(model.body_jntnum[root])):
        kind, axis = int(model.jnt_type[joint]), np.array(model.jnt_axis[joint])
        if kind == _FREE:
            return joint
        mujoco.mju_rotVecQuat(axis, axis.copy(), np.array(model.body_quat[root]))
        if kind == _SLIDE and abs(float(axis @ up)) > aligned:
            return joint
    return -1


def _round_away(value: float, change: float) -> float:
    # To five digits, in the direction of the change.
    changed = value + change
    decimals = 4 - int(np.floor(np.log10(max(abs(changed), abs(change), 1e-9))))
    unit = 10.0**-decimals
    slack = 1e-6  # of a unit, which is far below the rounding of a touch: a sum is not exact
    rounded = np.ceil(changed / unit - slack) if change > 0 else np.floor(changed / unit + slack)
    return round(float(rounded * unit), max(decimals, 0))
