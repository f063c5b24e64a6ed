"""Links that overlap whatever the joints between them do, so that their contact is never meant.

MuJoCo leaves out contacts of a link and its parent alone. A cover that hangs two joints from a link
that it surrounds touches it in every pose, and joints carry the force.
"""

from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.budget import Motion
from contactlab.contact.trace_arrays import Floats
from contactlab.scene.closed_start import OPEN_TOLERANCE, moving_extent
from contactlab.scene.model_names import name_of
from contactlab.studies.examine.standing_starts import begin_motion
from contactlab.studies.examine.start_fixes import find_overlapping_links, find_overlaps

_FREE, _BALL = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)
_HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)


class PermanentOverlap(NamedTuple):
    """Two bodies that overlap in all poses, and how deep they do at the start [m]."""

    names: tuple[str, str]
    depth: float


def find_permanent_overlaps(motion: Motion, poses: int = 64) -> list[PermanentOverlap]:
    """Return near links that overlap deeply at the start, and in all of many poses of all joints.

    The poses are drawn from the ranges of joints, always the same ones.
    """
    model, data = motion.model, begin_motion(motion)
    least = OPEN_TOLERANCE * moving_extent(model, data)
    near = {*find_overlapping_links(motion)}
    depths = {
        (one, two): depth
        for one, two, depth in find_overlaps(model, data)
        if (one, two) in near and depth > least
    }
    random = np.random.default_rng(0)
    remaining_pairs, extent = {*depths}, moving_extent(model, data)
    for _ in range(poses if remaining_pairs else 0):
        # Draw a pose of all joints except free ones.
        for joint in range(model.njnt):
            place, kind = int(model.jnt_qposadr[joint]), int(model.jnt_type[joint])
            if kind == _FREE:
                continue
            if kind == _BALL:
                turn: Floats = random.normal(size=4)
                data.qpos[place : place + 4] = turn / np.linalg.norm(turn)
                continue
            size = np.pi if kind == _HINGE else extent
            limited = bool(model.jnt_limited[joint])
            low, high = model.jnt_range[joint] if limited else (-size, size)
            data.qpos[place] = random.uniform(max(low, -1e3), min(high, 1e3))
        mujoco.mj_fwdPosition(model, data)
        remaining_pairs &= {(one, two) for one, two, _ in find_overlaps(model, data)}
    return [
        PermanentOverlap((name_of(model, "body", one), name_of(model, "body", two)), depth)
        for (one, two), depth in depths.items()
        if (one, two) in remaining_pairs
    ]
