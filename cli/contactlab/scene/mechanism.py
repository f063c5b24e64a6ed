"""The parts of a model that move and hold, by name, with their ranges."""

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.contact.trace_setup import Mechanism, Part, PartKind
from contactlab.scene.addresses import is_address

_KINDS: tuple[PartKind, ...] = ("free", "ball", "slide", "hinge")
_STANDARD_GRAVITY = 9.81
_AT_JOINT = [int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT)]


def find_mechanism(model: mujoco.MjModel) -> Mechanism:
    """Return the joints, tendons, actuators and equalities of a compiled scene.

    A joint without a name has its body's where that has no other.
    """
    lengths = _limits(model.tendon_limited, model.tendon_range)
    margins = np.asarray(model.tendon_margin)
    controls = _limits(model.actuator_ctrllimited, model.actuator_ctrlrange)
    springs = np.asarray(model.tendon_stiffness) != 0
    springs |= np.any(getattr(model, "tendon_stiffnesspoly", springs[:, None]), axis=1)
    return Mechanism(
        joints=tuple(_joint(model, index) for index in range(model.njnt)),
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
        equalities=tuple(model.equality(index).name for index in range(model.neq)),
        weight=float(model.body_mass.sum()) * _STANDARD_GRAVITY,
    )


def _limits(limited: np.ndarray, ranges: np.ndarray) -> Floats:
    """Return (n, 2) ranges, infinite where nothing is limited."""
    infinite = np.array([-np.inf, np.inf])
    return np.where(np.asarray(limited, bool)[:, None], ranges, infinite).reshape(-1, 2)


def _joint(model: mujoco.MjModel, index: int) -> Part:
    joint = model.joint(index)
    body = int(joint.bodyid[0])
    borrowed = is_address(joint.name) and model.body_jntnum[body] == 1
    low, high = _limits(model.jnt_limited, model.jnt_range)[index].tolist()
    kind = _KINDS[int(joint.type[0])]
    return Part(
        name=model.body(body).name if borrowed else joint.name,
        kind=kind,
        place=int(joint.qposadr[0]),
        # The only limit of a ball joint is on its angle.
        low=-np.inf if kind == "ball" else low,
        high=high,
        margin=float(model.jnt_margin[index]),
    )


def _force_limits(model: mujoco.MjModel) -> Floats:
    """Return (nu, 2) the limits of actuator forces, those of the joints that they move included."""
    limits = _limits(model.actuator_forcelimited, model.actuator_forcerange)
    for index in np.flatnonzero(np.isin(model.actuator_trntype, _AT_JOINT)):
        joint, gear = model.actuator_trnid[index, 0], model.actuator_gear[index, 0]
        if model.jnt_actfrclimited[joint] and gear:
            low, high = np.sort(model.jnt_actfrcrange[joint] / gear)
            limits[index] = max(limits[index, 0], low), min(limits[index, 1], high)
    return limits
