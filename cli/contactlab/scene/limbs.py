"""Which bodies walk: free roots with actuated limbs."""

from collections.abc import Iterator

import mujoco
import numpy as np


def actuated_limbs(model: mujoco.MjModel) -> dict[str, int]:
    """Return for each body on a free joint how many of its limbs have actuated joints, if any do.

    A limb is a child of the free body with everything that hangs on it.
    """
    driven = {int(model.jnt_bodyid[joint]) for joint in _driven_joints(model)}
    limbs: dict[int, set[int]] = {}
    for body in driven:
        chain = [body]
        while model.body_parentid[chain[-1]]:
            chain.append(int(model.body_parentid[chain[-1]]))
        if len(chain) > 1 and _is_free(model, chain[-1]):
            limbs.setdefault(chain[-1], set()).add(chain[-2])
    return {model.body(root).name or f"body{root}": len(each) for root, each in limbs.items()}


def _is_free(model: mujoco.MjModel, body: int) -> bool:
    joint = int(model.body_jntadr[body])
    return joint >= 0 and int(model.jnt_type[joint]) == mujoco.mjtJoint.mjJNT_FREE


def _driven_joints(model: mujoco.MjModel) -> Iterator[int]:
    kinds = mujoco.mjtTrn
    for actuator in range(model.nu):
        kind, item = int(model.actuator_trntype[actuator]), int(model.actuator_trnid[actuator, 0])
        if kind in (kinds.mjTRN_JOINT, kinds.mjTRN_JOINTINPARENT):
            yield item
        elif kind == kinds.mjTRN_TENDON:
            yield from _joints_of(model, item)


def _joints_of(model: mujoco.MjModel, tendon: int) -> Iterator[int]:
    """Yield the joints that a fixed tendon couples; a spatial tendon names none."""
    start = int(model.tendon_adr[tendon])
    wraps = np.arange(start, start + int(model.tendon_num[tendon]))
    for wrap in wraps:
        if int(model.wrap_type[wrap]) == mujoco.mjtWrap.mjWRAP_JOINT:
            yield int(model.wrap_objid[wrap])
