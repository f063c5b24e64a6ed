"""Finds the bodies that the elements of a model act on; reports about an element name them."""

from collections.abc import Iterable

import mujoco
import numpy as np

from contactlab.scene.model_names import name_of

_EQUALITY_TYPES = mujoco.mjtEq
_TRN = mujoco.mjtTrn
_WRAP = mujoco.mjtWrap
_SITE_TRANSMISSIONS = (int(_TRN.mjTRN_SITE), int(_TRN.mjTRN_SLIDERCRANK))
AT_JOINT = (int(_TRN.mjTRN_JOINT), int(_TRN.mjTRN_JOINTINPARENT))
"""Transmissions of actuators that move one joint."""


def moving_bodies(model: mujoco.MjModel, bodies: Iterable[int]) -> tuple[str, ...]:
    """Return the names of the bodies that can move, each once."""
    moving = dict.fromkeys(int(body) for body in bodies if body >= 0 and model.body_weldid[body])
    return tuple(name_of(model, "body", body) for body in moving)


def find_tendon_bodies(model: mujoco.MjModel, index: int) -> list[int]:
    """Return the bodies along a tendon: of its sites, its joints and its wrapping geoms."""
    first = int(model.tendon_adr[index])
    part = slice(first, first + int(model.tendon_num[index]))
    kinds, objects = model.wrap_type[part], np.asarray(model.wrap_objid[part])
    owners = {
        int(_WRAP.mjWRAP_SITE): model.site_bodyid,
        int(_WRAP.mjWRAP_JOINT): model.jnt_bodyid,
        int(_WRAP.mjWRAP_SPHERE): model.geom_bodyid,
        int(_WRAP.mjWRAP_CYLINDER): model.geom_bodyid,
    }
    return [
        int(np.asarray(owners[kind])[item])
        for kind, item in zip(kinds.tolist(), objects.tolist(), strict=True)
        if kind in owners
    ]


def bodies_of_tendon(model: mujoco.MjModel, index: int) -> tuple[str, ...]:
    """Return the names of the moving bodies along a tendon."""
    return moving_bodies(model, find_tendon_bodies(model, index))


def find_actuator_bodies(model: mujoco.MjModel, index: int) -> list[int]:
    """Return the bodies that an actuator moves."""
    kind, ends = int(model.actuator_trntype[index]), np.asarray(model.actuator_trnid[index])
    if kind in AT_JOINT:
        return np.asarray(model.jnt_bodyid)[ends[:1]].tolist()
    if kind == _TRN.mjTRN_TENDON:
        return find_tendon_bodies(model, int(ends[0]))
    if kind in _SITE_TRANSMISSIONS:
        return np.asarray(model.site_bodyid)[ends[ends >= 0]].tolist()
    return ends[:1].tolist() if kind == _TRN.mjTRN_BODY else []


def bodies_of_actuator(model: mujoco.MjModel, index: int) -> tuple[str, ...]:
    """Return the names of the moving bodies that an actuator moves."""
    return moving_bodies(model, find_actuator_bodies(model, index))


def find_equality_bodies(model: mujoco.MjModel, index: int) -> list[int]:
    """Return the bodies that an equality constraint connects; none for a flex."""
    kind = int(model.eq_type[index])
    ends = [int(model.eq_obj1id[index]), int(model.eq_obj2id[index])]
    if kind == _EQUALITY_TYPES.mjEQ_JOINT:
        return np.asarray(model.jnt_bodyid)[[end for end in ends if end >= 0]].tolist()
    if kind == _EQUALITY_TYPES.mjEQ_TENDON:
        return [body for end in ends if end >= 0 for body in find_tendon_bodies(model, end)]
    if kind not in {_EQUALITY_TYPES.mjEQ_CONNECT, _EQUALITY_TYPES.mjEQ_WELD}:
        return []
    if model.eq_objtype[index] == int(mujoco.mjtObj.mjOBJ_SITE):
        return np.asarray(model.site_bodyid)[ends].tolist()
    return ends


def bodies_of_equality(model: mujoco.MjModel, index: int) -> tuple[str, ...]:
    """Return the names of the moving bodies that an equality connects; none for a flex."""
    return moving_bodies(model, find_equality_bodies(model, index))


def is_held_from_outside(model: mujoco.MjModel, root: int) -> bool:
    """Return whether a constraint, a tendon or an actuator can carry the tree of a root body.

    Forces between two bodies of the tree carry nothing. A motor on its free joint does, and so may
    actuators that act on sites or bodies.
    """
    own = {*np.flatnonzero(model.body_rootid == model.body_rootid[root]).tolist()}
    connected = [
        *({*find_equality_bodies(model, index)} for index in range(model.neq)),
        *({*find_tendon_bodies(model, index)} for index in range(model.ntendon)),
    ]
    if any(bodies & own and bodies - own for bodies in connected):
        return True
    for index, kind in enumerate(model.actuator_trntype.tolist()):
        joint = int(model.actuator_trnid[index, 0])
        is_inner = kind == _TRN.mjTRN_TENDON or (
            kind in AT_JOINT and model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_FREE
        )
        if not is_inner and not own.isdisjoint(find_actuator_bodies(model, index)):
            return True
    return False


def is_mocap_driven(model: mujoco.MjModel) -> np.ndarray:
    """Return (neq,) whether an equality holds a body to a mocap body, which drives it.

    Its softness acts like the gain of a servo: it describes how a hand is led, not how rigid the
    model is. Its violation acts like the error of a servo and is not a fault.
    """
    kinds = (int(_EQUALITY_TYPES.mjEQ_CONNECT), int(_EQUALITY_TYPES.mjEQ_WELD))
    driven = np.zeros(model.neq, bool)
    for equality in np.flatnonzero(np.isin(model.eq_type, kinds)):
        ends = [int(ids[equality]) for ids in (model.eq_obj1id, model.eq_obj2id)]
        if int(model.eq_objtype[equality]) == mujoco.mjtObj.mjOBJ_SITE:
            ends = [int(model.site_bodyid[site]) for site in ends]
        driven[equality] = any(int(model.body_mocapid[body]) >= 0 for body in ends)
    return driven
