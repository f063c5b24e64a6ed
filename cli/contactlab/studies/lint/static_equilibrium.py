"""Checks whether an initial violation is held by load or will be pushed out.

A violated constraint requests an acceleration, `efc_aref`. In a start at rest, such as a lid on its
stop or a handle in closed fingers, loads and other constraints balance it, and the acceleration is
nearly zero. Without a balancing load, it is nearly the requested one.
"""

from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats


def is_in_equilibrium(model: mujoco.MjModel, data: mujoco.MjData, rows: slice) -> bool:
    """Return whether loads balance the mean of some constraint rows.

    The data is from `mj_forward`. A violation that grows is not in equilibrium.
    """
    acceleration = np.empty(data.nefc)
    mujoco.mj_mulJacVec(model, data, acceleration, data.qacc)
    target = float(data.efc_aref[rows].mean())
    pushed_share = 0.5  # share of the requested acceleration: 0 at rest, about 1 for a free body
    return bool(target > 0 and acceleration[rows].mean() < pushed_share * target)


def limit_rows(data: mujoco.MjData, joint: int) -> slice | None:
    """Return the row of a joint's limit, if it acts."""
    limits = data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT)
    rows = np.flatnonzero(limits & (data.efc_id == joint))
    return slice(int(rows[0]), int(rows[0]) + 1) if rows.size else None


def contact_rows(model: mujoco.MjModel, data: mujoco.MjData, contact: int) -> slice | None:
    """Return the rows of a contact with a mean along its normal, if it acts."""
    first, size = int(data.contact.efc_address[contact]), int(data.contact.dim[contact])
    if first < 0:
        return None
    elliptic = size == 1 or model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    return slice(first, first + (1 if elliptic else 2 * (size - 1)))


MANY_WEIGHTS = 10.0
"""Weights of all that moves that only joints, not gravity, can press bodies together with."""


class Pressing(NamedTuple):
    """A contact in balance that presses without motors and springs.

    Attributes:
        geoms: that touch.
        weights: its force over the weight of all that moves.
    """

    geoms: tuple[int, int]
    weights: float


def find_pressing(model: mujoco.MjModel, qpos: Floats) -> Iterator[Pressing]:
    """Yield the contacts that joints hold closed in a pose at rest."""
    gravity = float(np.linalg.norm(model.opt.gravity))
    weight = gravity * float(model.body_mass[model.body_weldid > 0].sum())
    if not weight:
        return
    idle, force = model.__copy__(), np.empty(6)
    idle.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    idle.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, "mjDSBL_SPRING", 0))
    data = mujoco.MjData(idle)
    data.qpos[:] = qpos
    mujoco.mj_forward(idle, data)
    for contact in range(data.ncon):
        rows, geoms = contact_rows(idle, data, contact), data.contact.geom[contact]
        if rows is not None and geoms.min() >= 0 and is_in_equilibrium(idle, data, rows):
            mujoco.mj_contactForce(idle, data, contact, force)
            yield Pressing((int(geoms[0]), int(geoms[1])), float(force[0]) / weight)
