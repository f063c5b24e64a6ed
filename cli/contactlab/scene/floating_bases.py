"""Finds floating bases that nothing can stop as they fall, and the joints that are driven."""

from collections.abc import Iterator

import mujoco
import numpy as np

from contactlab.scene.contact_pairs import touch_places
from contactlab.scene.model_names import name_of
from contactlab.scene.part_bodies import AT_JOINT, is_held_from_outside

_FREE = int(mujoco.mjtJoint.mjJNT_FREE)
_SCALAR = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))


def list_unsupported_roots(model: mujoco.MjModel) -> Iterator[int]:
    """Yield floating bases that can touch nothing but their own links, and that nothing carries."""
    falls = np.linalg.norm(model.opt.gravity) > 0 and not (
        model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    )
    floats = model.opt.density > 0 or model.body_gravcomp.any() or model.nmocap or model.nflex
    if not falls or floats:
        return
    free = np.asarray(model.jnt_bodyid)[model.jnt_type == _FREE].tolist()
    roots = [root for root in free if not is_held_from_outside(model, root)]
    if not roots:
        return
    owners = model.body_rootid[model.geom_bodyid]
    first, second = (owners[side] for side in touch_places(model))
    apart = first != second
    touching = {*first[apart].tolist(), *second[apart].tolist()}
    yield from (root for root in roots if int(model.body_rootid[root]) not in touching)


def find_driven_joints(model: mujoco.MjModel, root: int) -> list[int]:
    """Return the hinges and slides of a root's tree that an actuator drives."""
    at_joint = np.isin(model.actuator_trntype, AT_JOINT)
    joints = np.asarray(model.actuator_trnid)[at_joint, 0]
    driven = joints[np.isin(model.jnt_type[joints], _SCALAR)]
    is_own = model.body_rootid[model.jnt_bodyid[driven]] == model.body_rootid[root]
    return [int(joint) for joint in driven[is_own]]


def find_falling_robot(model: mujoco.MjModel) -> str:
    """Return the name of the first robot, a floating base with joints, that nothing can stop."""
    for root in list_unsupported_roots(model):
        if count_own_joints(model, root):
            return name_of(model, "body", root)
    return ""


def count_own_joints(model: mujoco.MjModel, root: int) -> int:
    """Return the number of hinges and slides of a root's tree."""
    own = model.body_rootid[model.jnt_bodyid] == model.body_rootid[root]
    return int(np.count_nonzero(own & np.isin(model.jnt_type, _SCALAR)))
