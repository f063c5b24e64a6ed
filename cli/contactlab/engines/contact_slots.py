"""Contact slots from the engine's own list of contacts, for engines whose sensors lack them.

Bit for bit what MuJoCo's contact sensors measure since 3.16, as they are read here: reduction
`none` for pairs, `mindist` over all contacts.
"""

from collections.abc import Sequence

import mujoco
import numpy as np

from contactlab.contact import (
    ANGULAR_VELOCITY,
    DISTANCE,
    FORCE,
    FOUND,
    LINEAR_VELOCITY,
    NORMAL,
    POSITION,
    SLOT_WIDTH,
    TANGENT,
    TORQUE,
    Floats,
)
from contactlab.scene import PREFIX

_USER = int(mujoco.mjtSensor.mjSENS_USER)
_GEOM = int(mujoco.mjtObj.mjOBJ_GEOM)
_BODY = int(mujoco.mjtObj.mjOBJ_BODY)
_SLEEP = int(getattr(mujoco.mjtEnableBit, "mjENBL_SLEEP", 0))
_ASLEEP, _AWAKE = 0, 1
_LAST_STAGE = int(mujoco.mjtStage.mjSTAGE_ACC)
# What changes sign when a contact is seen from its other geom: normal, tangent, third components.
_TURNING = [11, 12, 13, 14, 15, 16, FORCE.stop - 1, TORQUE.stop - 1, 19, 22]


def contact_slots(model: mujoco.MjModel) -> "ContactSlots | None":
    """Return what fills the sensors of a model that have only room; None if it has none."""
    places = [
        index
        for index in range(model.nsensor)
        if model.sensor_type[index] == _USER and model.sensor(index).name.startswith(PREFIX)
    ]
    return ContactSlots(places) if places else None


class ContactSlots:
    """Fills sensors of one run, as MuJoCo's sensor callback.

    It is called within a step, at the state before it, with the forces that act during it; with
    RK4, at its first stage.
    """

    def __init__(self, places: Sequence[int]) -> None:
        self._places = places
        self._last: dict[int, Floats] = {}

    def __call__(self, model: mujoco.MjModel, data: mujoco.MjData, stage: int) -> None:
        """Fill the sensors once all that they measure is computed."""
        if stage != _LAST_STAGE:
            return
        measured = _measured(model, data) if data.ncon else None
        for place in self._places:
            begin = int(model.sensor_adr[place])
            row = data.sensordata[begin : begin + int(model.sensor_dim[place])]
            if _sleeps(model, data, place):
                # The engine empties sensors that it leaves to a callback.
                row[:] = self._last.get(place, 0.0)
                continue
            row[:] = 0
            if measured is not None:
                _fill(model, data, place, measured, row)
            self._last[place] = row.copy()


def _fill(
    model: mujoco.MjModel, data: mujoco.MjData, place: int, measured: Floats, row: Floats
) -> None:
    if model.sensor_objtype[place] in (_GEOM, _BODY):
        _fill_pair(model, data, place, measured, row.reshape(-1, SLOT_WIDTH))
    else:
        row[:] = data.ncon, data.contact.dist.min()


def _fill_pair(
    model: mujoco.MjModel, data: mujoco.MjData, place: int, measured: Floats, slots: Floats
) -> None:
    """Fill a pair's slots with its first contacts.

    Where a contact's geoms are the other way round, its normal and tangent turn, the third axis
    stays, and what acts on the other body is opposite: along two axes nothing changes, along the
    third the sign does.
    """
    sides = _sides(model, data, body=bool(model.sensor_objtype[place] == _BODY))
    pair = np.array([model.sensor_objid[place], model.sensor_refid[place]])
    turned = (sides == pair[::-1]).all(axis=1)
    found = np.flatnonzero(turned | (sides == pair).all(axis=1))
    kept = found[: len(slots)]
    rows = measured[kept]
    rows[:, FOUND] = len(found)
    rows[np.ix_(turned[kept], _TURNING)] *= -1.0
    slots[: len(rows)] = rows


def _sleeps(model: mujoco.MjModel, data: mujoco.MjData, place: int) -> bool:
    """Say whether a pair sleeps: its contacts are no longer found, and its slots stay."""
    if not model.opt.enableflags & _SLEEP or model.sensor_objtype[place] not in (_GEOM, _BODY):
        return False
    pair = [int(model.sensor_objid[place]), int(model.sensor_refid[place])]
    bodies = pair if model.sensor_objtype[place] == _BODY else model.geom_bodyid[pair]
    states = data.body_awake[bodies]
    return not (states == _AWAKE).any() and bool((states == _ASLEEP).any())


def _sides(model: mujoco.MjModel, data: mujoco.MjData, *, body: bool) -> np.ndarray:
    """Return (ncon, 2) the geoms of each contact, or their bodies; -1 for a flex."""
    geoms = np.asarray(data.contact.geom)
    return np.where(geoms >= 0, model.geom_bodyid[geoms], -1) if body else geoms


def _measured(model: mujoco.MjModel, data: mujoco.MjData) -> Floats:
    """Return (ncon, 23) a slot for each contact, seen from its own first geom."""
    contact = data.contact
    slots, force = np.zeros((data.ncon, SLOT_WIDTH)), np.empty(6)
    for row in range(data.ncon):
        mujoco.mj_contactForce(model, data, row, force)
        slots[row, FORCE], slots[row, TORQUE] = force[:3], force[3:]
    frame, point = contact.frame.reshape(-1, 3, 3), contact.pos
    slots[:, DISTANCE], slots[:, POSITION] = contact.dist, point
    slots[:, NORMAL], slots[:, TANGENT] = frame[:, 0], frame[:, 1]
    before, after = (_velocity(model, data, side, point) for side in contact.geom.T)
    slots[:, LINEAR_VELOCITY] = _in_frame(frame, after[0] - before[0])
    slots[:, ANGULAR_VELOCITY] = _in_frame(frame, after[1] - before[1])
    return slots


def _velocity(
    model: mujoco.MjModel, data: mujoco.MjData, geoms: np.ndarray, points: Floats
) -> tuple[Floats, Floats]:
    """Return the velocities of points on the bodies of geoms, and their angular velocities."""
    bodies = model.geom_bodyid[geoms]
    spatial = data.cvel[bodies]
    offset = points - data.subtree_com[model.body_rootid[bodies]]
    x, y, z = (offset[:, axis] for axis in range(3))
    p, q, r = (spatial[:, axis] for axis in range(3))
    turning = np.stack((y * r - z * q, z * p - x * r, x * q - y * p), axis=1)
    return spatial[:, 3:] - turning, spatial[:, :3]


def _in_frame(frame: Floats, vectors: Floats) -> Floats:
    """Return vectors' components, summed in the engine's order; a matrix product may fuse."""
    x, y, z = (vectors[:, axis, None] for axis in range(3))
    return frame[:, :, 0] * x + frame[:, :, 1] * y + frame[:, :, 2] * z
