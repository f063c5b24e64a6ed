"""The joints, tendons, actuators and equality constraints of a model, with their ranges."""

from collections.abc import Iterator

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.contact.trace_setup import QUARTER_TURN, Equality, Mechanism, Part, PartKind
from contactlab.scene.contact_pairs import reaches
from contactlab.scene.model_names import is_address

_EQUALITY = mujoco.mjtEq
_JOINT = mujoco.mjtJoint
_KINDS: tuple[PartKind, ...] = ("free", "ball", "slide", "hinge")
_STANDARD_GRAVITY = 9.81
AT_JOINT = [int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT)]
"""Transmissions of actuators that act on one joint."""


def find_mechanism(model: mujoco.MjModel) -> Mechanism:
    """Return the joints, tendons, actuators and equalities of a compiled scene.

    A joint without a name has its body's where that has no other.
    """
    lengths = _limits(model.tendon_limited, model.tendon_range)
    margins = np.asarray(model.tendon_margin)
    controls = _limits(model.actuator_ctrllimited, model.actuator_ctrlrange)
    springs = np.asarray(model.tendon_stiffness) != 0
    springs |= np.any(getattr(model, "tendon_stiffnesspoly", springs[:, None]), axis=1)
    places = _limits(model.jnt_limited, model.jnt_range)
    reach, ends = _reaches(model), equality_reach(model)
    return Mechanism(
        joints=tuple(_joint(model, index, places[index], reach) for index in range(model.njnt)),
        tendons=tuple(
            Part(model.tendon(index).name, "tendon", index, *lengths[index], margin=margins[index])
            for index in range(model.ntendon)
        ),
        actuators=tuple(
            Part(model.actuator(index).name, "actuator", index, *controls[index])
            for index in range(model.nu)
        ),
        slack=np.where(springs[:, None], np.reshape(model.tendon_lengthspring, (-1, 2)), np.nan),
        forces=_force_limits(model),
        equalities=tuple(
            _equality(model, index, places, reach, float(ends[index])) for index in range(model.neq)
        ),
        weight=float(model.body_mass.sum()) * _STANDARD_GRAVITY,
        size=float(model.stat.meansize),
    )


def _reaches(model: mujoco.MjModel) -> Floats:
    """Return (nbody,) how far bodies reach; without geoms, as far as bodies do on average [m]."""
    reach = reaches(model)
    return np.where(reach > 0, reach, model.stat.meansize)


def equality_reach(model: mujoco.MjModel) -> Floats:
    """Return (neq,) the reach [m] of the smaller body that each connects or welds; else inf."""
    ends = np.stack([model.eq_obj1id, model.eq_obj2id])
    sited = model.eq_objtype == int(mujoco.mjtObj.mjOBJ_SITE)
    ends[:, sited] = np.asarray(model.site_bodyid)[ends[:, sited]]
    tied = np.isin(model.eq_type, (int(_EQUALITY.mjEQ_CONNECT), int(_EQUALITY.mjEQ_WELD)))
    ends = np.where(tied, ends, 0)
    return np.where(ends > 0, _reaches(model)[ends], np.inf).min(axis=0)


def _equality(
    model: mujoco.MjModel, index: int, places: Floats, reach: Floats, ends: float
) -> Equality:
    kind, first = int(model.eq_type[index]), int(model.eq_obj1id[index])
    name = model.equality(index).name
    if kind == _EQUALITY.mjEQ_TENDON:
        return Equality(name, "m", _tendon_scale(model, first))
    if kind == _EQUALITY.mjEQ_FLEX:
        edges = slice(model.flex_edgeadr[first], None)
        lengths = model.flexedge_length0[edges][: model.flex_edgenum[first]]
        return Equality(name, "m", float(lengths.mean()))
    if kind != _EQUALITY.mjEQ_JOINT:
        return Equality(name, "m", ends)
    low, high = places[first].tolist()
    if int(model.jnt_type[first]) == _JOINT.mjJNT_HINGE:
        return Equality(name, "rad", min(high - low, QUARTER_TURN))
    return Equality(name, "m", min(high - low, float(reach[model.jnt_bodyid[first]])))


def _limits(limited: np.ndarray, ranges: np.ndarray) -> Floats:
    """Return (n, 2) ranges, infinite where nothing is limited."""
    infinite = np.array([-np.inf, np.inf])
    return np.where(np.asarray(limited, bool)[:, None], ranges, infinite).reshape(-1, 2)


def _joint(model: mujoco.MjModel, index: int, places: Floats, reach: Floats) -> Part:
    joint = model.joint(index)
    body = int(joint.bodyid[0])
    borrowed = is_address(joint.name) and model.body_jntnum[body] == 1
    low, high = places.tolist()
    kind = _KINDS[int(joint.type[0])]
    return Part(
        name=model.body(body).name if borrowed else joint.name,
        kind=kind,
        place=int(joint.qposadr[0]),
        # The only limit of a ball joint is on its angle.
        low=-np.inf if kind == "ball" else low,
        high=high,
        margin=float(model.jnt_margin[index]),
        reach=float(reach[body]),
    )


def _force_limits(model: mujoco.MjModel) -> Floats:
    """Return (nu, 2) the limits of actuator forces, those of the joints that they move included."""
    limits = _limits(model.actuator_forcelimited, model.actuator_forcerange)
    for index in np.flatnonzero(np.isin(model.actuator_trntype, AT_JOINT)):
        joint, gear = model.actuator_trnid[index, 0], model.actuator_gear[index, 0]
        if model.jnt_actfrclimited[joint] and gear:
            low, high = np.sort(model.jnt_actfrcrange[joint] / gear)
            limits[index] = max(limits[index, 0], low), min(limits[index, 1], high)
    return limits


def _tendon_scale(model: mujoco.MjModel, tendon: int) -> float:
    """Return a spatial tendon's length [m]; of a fixed one, what a quarter turn makes of it."""
    wraps = slice(model.tendon_adr[tendon], model.tendon_adr[tendon] + model.tendon_num[tendon])
    if model.wrap_type[wraps.start] != int(mujoco.mjtWrap.mjWRAP_JOINT):
        return float(model.tendon_length0[tendon])
    return float(np.abs(model.wrap_prm[wraps]).max() * QUARTER_TURN)


def actuated_limbs(model: mujoco.MjModel) -> dict[str, int]:
    """Return how many limbs with actuated joints each body on a free joint has, if any.

    A limb is a child of the free body with all of its descendants.
    """
    limbs: dict[int, set[int]] = {}
    for body in {int(model.jnt_bodyid[joint]) for joint in _driven_joints(model)}:
        chain = [body]
        while model.body_parentid[chain[-1]]:
            chain.append(int(model.body_parentid[chain[-1]]))
        joint = int(model.body_jntadr[chain[-1]])
        if len(chain) > 1 and joint >= 0 and int(model.jnt_type[joint]) == _JOINT.mjJNT_FREE:
            limbs.setdefault(chain[-1], set()).add(chain[-2])
    return {model.body(root).name: len(each) for root, each in limbs.items()}


def _driven_joints(model: mujoco.MjModel) -> Iterator[int]:
    """Yield the joints that actuators move; a spatial tendon names none."""
    for kind, item in zip(model.actuator_trntype, model.actuator_trnid[:, 0], strict=True):
        if kind in AT_JOINT:
            yield int(item)
        elif kind == mujoco.mjtTrn.mjTRN_TENDON:
            wraps = slice(model.tendon_adr[item], model.tendon_adr[item] + model.tendon_num[item])
            joints = model.wrap_type[wraps] == int(mujoco.mjtWrap.mjWRAP_JOINT)
            yield from model.wrap_objid[wraps][joints].tolist()
