"""Rollouts of one model from given states, with inputs of each step, and contact forces."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from contactlab.budget.motion import INTEGRATION
from contactlab.budget.windows import start_rows
from contactlab.contact.trace_arrays import Floats
from contactlab.engines.older_mujoco import SimulationError

_BORNE = "qfrc_constraint"
_QPOS = int(mujoco.mjtState.mjSTATE_QPOS)
_INPUTS = int(mujoco.mjtState.mjSTATE_CTRL) | int(mujoco.mjtState.mjSTATE_XFRC_APPLIED)
_SENSORS = int(mujoco.mjtDisableBit.mjDSBL_SENSOR) | int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)


class RolledRuns(NamedTuple):
    """Runs of one model.

    Attributes:
        qpos: (n, N, nq) after each step; a failed run repeats its last.
        rows: (n, nstate) states of mjSTATE_INTEGRATION after the last step.
        failed: (n,) whether MuJoCo gave up.
        borne: (n, N, nv) constraint forces, if requested.
    """

    qpos: Floats
    rows: Floats
    failed: np.ndarray
    borne: Floats | None = None


def start_row(model: mujoco.MjModel, qpos: Floats | None = None) -> Floats:
    """Return a state of mjSTATE_INTEGRATION at rest: at a configuration, or at qpos0."""
    data = mujoco.MjData(model)
    if qpos is not None:
        data.qpos[:] = qpos
    return state_row(model, data)


def state_row(model: mujoco.MjModel, data: mujoco.MjData) -> Floats:
    """Return the state of some data."""
    row = np.empty(mujoco.mj_stateSize(model, INTEGRATION))
    mujoco.mj_getState(model, data, row, INTEGRATION)
    return row


def data_at(model: mujoco.MjModel, row: Floats) -> mujoco.MjData:
    """Return data at a state, with its contacts and forces."""
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, row, INTEGRATION)
    mujoco.mj_forward(model, data)
    return data


def roll_out(
    model: mujoco.MjModel,
    rows: Floats,
    controls: Floats,
    applied: Floats | None = None,
    *,
    borne: bool = False,
) -> RolledRuns:
    """Roll out runs from (n, nstate) states.

    Controls are (n, N, nu). Applied forces and torques are (n, N, nbody, 6) [N, N m], in the world
    frame, or None.
    """
    alone = model.__copy__()
    alone.opt.disableflags |= _SENSORS
    count, steps = controls.shape[:2]
    forces = np.zeros((count, steps, 6 * model.nbody))
    if applied is not None:
        forces[:] = applied.reshape(*applied.shape[:2], -1)
    batch = start_rows(alone, rows, 1)
    before = batch.warning[:, :, 1].copy()
    failed = np.zeros(count, bool)
    out: dict[Any, np.ndarray] = {_QPOS: np.full((count, steps, model.nq), np.nan)}
    if borne:
        out[_BORNE] = np.full((count, steps, model.nv), np.nan)
    inputs = np.concatenate([controls, forces], axis=2)
    try:
        batch.rollout(steps, inputs, _INPUTS, record=list(out), out=out)
    except SimulationError:
        failed = np.array([bool(batch.error(row)) for row in range(count)])
    failed |= (batch.warning[:, :, 1] != before).any(axis=1)
    return RolledRuns(out[_QPOS], batch.state.copy(), failed, out.get(_BORNE))


def states_along(
    model: mujoco.MjModel, row: Floats, controls: Floats, applied: Floats, every: int
) -> Floats:
    """Return (K, nstate) states of one run, one per `every` steps.

    Controls are (N, nu), forces on bodies (N, nbody, 6).
    """
    rows = [row]
    for begin in range(0, len(controls), every):
        part = slice(begin, begin + every)
        rows.append(
            roll_out(model, rows[-1][None], controls[None, part], applied[None, part]).rows[0]
        )
    return np.array(rows)


class BodyContact(NamedTuple):
    """A contact of the object with a geom.

    Attributes:
        geom: the other side's geom.
        point: (3,) world frame [m].
        normal: (3,) unit vector into the object, world frame.
        force: normal force [N].
        tangential: magnitude of the friction [N].
        depth: of penetration [m].
        friction: coefficient of sliding friction.
    """

    geom: int
    point: Floats
    normal: Floats
    force: float
    tangential: float
    depth: float
    friction: float


def find_contacts(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> list[BodyContact]:
    """Return the contacts of a body and the bodies that are fixed to it."""
    own, contacts, force = model.body_weldid[body], list[BodyContact](), np.empty(6)
    for place in range(data.ncon):
        contact = data.contact[place]
        if contact.geom.min() < 0 or contact.efc_address < 0:
            continue
        sides = model.body_weldid[model.geom_bodyid[contact.geom]]
        if (sides == own).sum() != 1:
            continue
        second = bool(sides[1] == own)
        mujoco.mj_contactForce(model, data, place, force)
        contacts.append(
            BodyContact(
                geom=int(contact.geom[0 if second else 1]),
                point=contact.pos.copy(),
                normal=contact.frame[:3] * (1.0 if second else -1.0),
                force=float(force[0]),
                tangential=float(np.hypot(force[1], force[2])),
                depth=-float(contact.dist),
                friction=float(contact.friction[0]),
            )
        )
    return contacts


def body_frames(
    model: mujoco.MjModel, configurations: Sequence[Floats] | Floats, body: int, base: int
) -> Floats:
    """Return (K, 3) positions of a body's center of mass in a base frame [m]."""
    data = mujoco.MjData(model)
    positions = np.empty((len(configurations), 3))
    for place, qpos in enumerate(configurations):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        turn = data.xmat[base].reshape(3, 3)
        positions[place] = (data.xipos[body] - data.xpos[base]) @ turn
    return positions


def repeat_input(values: Floats, runs: int, steps: int) -> Floats:
    """Return constant inputs (n, N, ...)."""
    return np.broadcast_to(values, (runs, steps, *np.shape(values))).copy()
