"""MuJoCo before 3.17: batches as loops over `mj_step`, contact slots from the list of contacts.

`StepLoop` has the part of `mujoco.batch.Batch` that contactlab uses: the same names, arrays and
bits, but slower by Python's time for each step. `ContactSlots` fills the sensors of versions before
3.16, bit for bit like later contact sensors, with reduction `none` for pairs and `mindist` over all
contacts.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import (
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
from contactlab.scene.compile_model import SENSOR_PREFIX
from contactlab.scene.model_edits import read_flag
from contactlab.scene.mujoco_versions import has_batch

if TYPE_CHECKING or has_batch():
    from mujoco.batch import SimulationError
else:

    class SimulationError(RuntimeError):
        """MuJoCo raised an error in some runs; `StepLoop.error` has the message of each."""

        def __init__(self, ids: np.ndarray, message: str) -> None:
            super().__init__(f"run {ids[0]}: {message}")


_INTEGRATION = int(mujoco.mjtState.mjSTATE_INTEGRATION)
_WARNING_KINDS = int(mujoco.mjtWarning.mjNWARNING)
_USER_SENSOR = int(mujoco.mjtSensor.mjSENS_USER)
_GEOM_OBJECT = int(mujoco.mjtObj.mjOBJ_GEOM)
_BODY_OBJECT = int(mujoco.mjtObj.mjOBJ_BODY)
_LAST_STAGE = int(mujoco.mjtStage.mjSTAGE_ACC)
# Entries that change sign when a contact is seen from its other geom: normal, tangent, and third
# components, because the third axis stays, and the force is reversed.
_FLIPPED_ENTRIES = [11, 12, 13, 14, 15, 16, FORCE.stop - 1, TORQUE.stop - 1, 19, 22]


class StepLoop:
    """Runs of one layout, stepped one by one; `state` (n, nstate) suffices to continue."""

    def __init__(
        self, model: mujoco.MjModel, nsim: int, nthread: int = 1, persistent: bool = False
    ) -> None:
        """Hold `nsim` runs of a model; a persistent loop keeps the data of each between calls."""
        assert nthread == 1
        self._models = [model] * nsim
        self._data = dict[int, mujoco.MjData]()
        self._persistent = persistent
        self._errors = [""] * nsim
        self.state = np.zeros((nsim, mujoco.mj_stateSize(model, _INTEGRATION)))
        # The last location of each warning, and its count.
        self.warning = np.zeros((nsim, _WARNING_KINDS, 2), np.int32)

    @property
    def model(self) -> mujoco.MjModel:
        """The first run's model, and so the layout of all."""
        return self._models[0]

    def set_models(self, models: Sequence[mujoco.MjModel]) -> None:
        """Give each run its own model."""
        self._models = list(models)

    def reset(self, stage: int) -> None:  # noqa: ARG002 - nothing is computed before a step
        """Put every run at the initial state of the first one's model."""
        mujoco.mj_getState(self.model, mujoco.MjData(self.model), self.state[0], _INTEGRATION)
        self.state[1:] = self.state[0]

    def bind(self, name: str) -> Floats:
        """Return a view of a part of the state: time, qpos, qvel, act, ctrl or xfrc_applied."""
        model = self.model
        state_bit = int(getattr(mujoco.mjtState, f"mjSTATE_{name.upper()}"))
        begin = mujoco.mj_stateSize(model, state_bit - 1 & _INTEGRATION)
        part = self.state[:, begin : begin + mujoco.mj_stateSize(model, state_bit)]
        if name == "xfrc_applied":
            return part.reshape(len(part), -1, 6)
        return part[:, 0] if name == "time" else part

    def error(self, run: int) -> str:
        """Return the error that MuJoCo raised in a run's last call, or an empty string."""
        return self._errors[run]

    def rollout(
        self,
        nstep: int,
        control: Floats | None = None,
        control_spec: int = 0,
        record: Sequence[Any] = (),
        ids: Sequence[int] | None = None,
        out: dict[Any, np.ndarray] | None = None,
    ) -> dict[Any, np.ndarray]:
        """Make steps and record after each; a run that warns stops, and its last row is repeated.

        Raises a SimulationError if MuJoCo raised an error; those runs keep their previous state.
        """
        runs = list(range(len(self._models)) if ids is None else ids)
        arrays = out or {item: self._empty_array(item, len(runs), nstep) for item in record}
        count_index = 1  # of the number of warnings, after the time of the last one
        for place, run in enumerate(runs):
            rows = {item: array[place] for item, array in arrays.items()}
            # Before 3.4, MuJoCo accepted only contiguous, writable rows.
            inputs = (
                None if control is None else (control_spec, np.array(control[place], order="C"))
            )
            self._errors[run] = ""
            try:
                model = self._models[run]
                data = self._data.get(run) or mujoco.MjData(model)
                if self._persistent:
                    self._data[run] = data
                mujoco.mj_setState(model, data, self.state[run], _INTEGRATION)
                counts = data.warning.number
                before = counts.copy()
                mujoco.set_mjcb_sensor(ContactSlots.of(model) if rows else None)
                try:
                    if rows or inputs is not None:
                        _step_and_record(model, data, nstep, inputs, rows)
                    else:
                        mujoco.mj_step(model, data, nstep=nstep)
                finally:
                    mujoco.set_mjcb_sensor(None)
                self.warning[run, :, count_index] += data.warning.number - before
                mujoco.mj_getState(model, data, self.state[run], _INTEGRATION)
            except mujoco.FatalError as error:
                self._errors[run] = str(error)
        failed = [run for run in runs if self._errors[run]]
        if failed:
            raise SimulationError(np.array(failed), self._errors[failed[0]])
        return arrays

    def _empty_array(self, item: int | str, runs: int, steps: int) -> np.ndarray:
        model = self.model
        if isinstance(item, int):
            return np.empty((runs, steps, mujoco.mj_stateSize(model, item)))
        own = np.asarray(getattr(mujoco.MjData(model), item))
        return np.empty((runs, steps, *(own.shape or (1,))), own.dtype)


def _step_and_record(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    steps: int,
    inputs: tuple[int, Floats] | None,
    rows: dict[Any, np.ndarray],
) -> None:
    """Step, and copy the requested items into row k after step k."""
    # Keep a view, because reading the attribute takes longer than many steps.
    counts = data.warning.number
    before = counts.tobytes()
    states = [(item, array) for item, array in rows.items() if isinstance(item, int)]
    fields = [(item, array) for item, array in rows.items() if isinstance(item, str)]
    for step in range(steps):
        if inputs is not None:
            mujoco.mj_setState(model, data, inputs[1][step], inputs[0])
        mujoco.mj_step(model, data)
        for item, array in states:
            mujoco.mj_getState(model, data, array[step], item)
        for item, array in fields:
            array[step] = getattr(data, item)
        if counts.tobytes() != before:
            for array in rows.values():
                array[step + 1 :] = array[step]
            return


class ContactSlots:
    """Fills user sensors of one run, as MuJoCo's sensor callback, with the forces of a step."""

    def __init__(self, sensors: Sequence[int]) -> None:
        self._sensors = sensors
        self._last: dict[int, Floats] = {}

    @classmethod
    def of(cls, model: mujoco.MjModel) -> "ContactSlots | None":
        """Return the callback for user sensors in place of contact sensors, if a model has any."""
        sensors = [
            index
            for index in range(model.nsensor)
            if model.sensor_type[index] == _USER_SENSOR
            and model.sensor(index).name.startswith(SENSOR_PREFIX)
        ]
        return cls(sensors) if sensors else None

    def __call__(self, model: mujoco.MjModel, data: mujoco.MjData, stage: int) -> None:
        """Fill the sensors after all of their inputs are computed."""
        if stage != _LAST_STAGE:
            return
        contact_values = measure_contacts(model, data) if data.ncon else None
        for sensor in self._sensors:
            begin = int(model.sensor_adr[sensor])
            row = data.sensordata[begin : begin + int(model.sensor_dim[sensor])]
            if _is_asleep(model, data, sensor):
                # MuJoCo sets sensors with a callback to zero.
                row[:] = self._last.get(sensor, 0.0)
                continue
            row[:] = 0
            if contact_values is not None and model.sensor_objtype[sensor] in (
                _GEOM_OBJECT,
                _BODY_OBJECT,
            ):
                bodies = model.sensor_objtype[sensor] == _BODY_OBJECT
                sides = model.sensor_objid[sensor], model.sensor_refid[sensor]
                pair = np.array([bodies, *sides])
                fill_pair(model, data, pair, contact_values, row.reshape(-1, SLOT_WIDTH))
            elif contact_values is not None:
                row[:] = data.ncon, data.contact.dist.min()
            self._last[sensor] = row.copy()


def fill_pair(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    pair: np.ndarray,
    contact_values: Floats,
    slots: Floats,
) -> None:
    """Fill a pair's slots with its first contacts, flipped if their geoms are in reverse order.

    The pair tells whether its sides are bodies, and names both.
    """
    sides = np.asarray(data.contact.geom)
    bodies, pair = pair[0], pair[1:]
    if bodies:
        # A flex has neither geom nor body.
        sides = np.where(sides >= 0, model.geom_bodyid[sides], -1)
    flipped = (sides == pair[::-1]).all(axis=1)
    contacts = np.flatnonzero(flipped | (sides == pair).all(axis=1))
    kept_contacts = contacts[: len(slots)]
    rows = contact_values[kept_contacts]
    rows[:, FOUND] = len(contacts)
    rows[np.ix_(flipped[kept_contacts], _FLIPPED_ENTRIES)] *= -1.0
    slots[: len(rows)] = rows


def _is_asleep(model: mujoco.MjModel, data: mujoco.MjData, sensor: int) -> bool:
    """Return whether a pair is asleep: its contacts are not computed, and its slots stay."""
    if not read_flag(model, "sleep") or model.sensor_objtype[sensor] not in (
        _GEOM_OBJECT,
        _BODY_OBJECT,
    ):
        return False
    pair = [int(model.sensor_objid[sensor]), int(model.sensor_refid[sensor])]
    bodies = pair if model.sensor_objtype[sensor] == _BODY_OBJECT else model.geom_bodyid[pair]
    states = data.body_awake[bodies]
    asleep, awake = 0, 1  # numbers of mjtSleepState
    return not (states == awake).any() and bool((states == asleep).any())


def measure_contacts(model: mujoco.MjModel, data: mujoco.MjData) -> Floats:
    """Return (ncon, 23) a slot for each contact, seen from its own first geom."""
    contact = data.contact
    slots, force = np.zeros((data.ncon, SLOT_WIDTH)), np.empty(6)
    for row in range(data.ncon):
        mujoco.mj_contactForce(model, data, row, force)
        slots[row, FORCE], slots[row, TORQUE] = force[:3], force[3:]
    frame, point = contact.frame.reshape(-1, 3, 3), contact.pos
    slots[:, DISTANCE], slots[:, POSITION] = contact.dist, point
    slots[:, NORMAL], slots[:, TANGENT] = frame[:, 0], frame[:, 1]
    before, after = (_point_velocities(model, data, side, point) for side in contact.geom.T)
    slots[:, LINEAR_VELOCITY] = _frame_components(frame, after[0] - before[0])
    slots[:, ANGULAR_VELOCITY] = _frame_components(frame, after[1] - before[1])
    return slots


def _point_velocities(
    model: mujoco.MjModel, data: mujoco.MjData, geoms: np.ndarray, points: Floats
) -> tuple[Floats, Floats]:
    bodies = model.geom_bodyid[geoms]
    spatial = data.cvel[bodies]
    offset = points - data.subtree_com[model.body_rootid[bodies]]
    x, y, z = (offset[:, axis] for axis in range(3))
    p, q, r = (spatial[:, axis] for axis in range(3))
    rotational = np.stack((y * r - z * q, z * p - x * r, x * q - y * p), axis=1)
    return spatial[:, 3:] - rotational, spatial[:, :3]


def _frame_components(frame: Floats, vectors: Floats) -> Floats:
    """Return vectors' components, summed in MuJoCo's order; matrix products may fuse operations."""
    x, y, z = (vectors[:, axis, None] for axis in range(3))
    return frame[:, :, 0] * x + frame[:, :, 1] * y + frame[:, :, 2] * z
