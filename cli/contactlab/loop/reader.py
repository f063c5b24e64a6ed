"""Reads the steps of a loop while they are made, in the shape of contactlab's own rollouts.

Row k has the state before step k, the forces in it, and its inputs, with the bits of a sweep's run.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import partial

import mujoco
import numpy as np
from mujoco import mj_step  # as a name of its own, since a recording may replace the module's

from contactlab.contact.trace_arrays import OTHERS, SLOT_WIDTH, Floats, RecordedControls
from contactlab.engines.contact_kernel import Kernel, recorded_slots, usable_kernel
from contactlab.engines.engine import PreparedRuns, Rollout, RolloutArrays
from contactlab.engines.mujoco_batch import PERSISTENT, STATE, Recorder, completed_rollout
from contactlab.engines.older_mujoco import fill_pair, measure_contacts
from contactlab.engines.sampled_loads import with_loads
from contactlab.engines.step_work import EnergyLedger
from contactlab.errors import SceneError
from contactlab.numerical_tolerance import ROUNDING
from contactlab.scene.compiled_scene import CompiledScene
from contactlab.scene.contact_pairs import MonitoredPair
from contactlab.scene.initial_states import InitialStates, quaternion_indices
from contactlab.scene.model_names import require_id
from contactlab.scene.timed_inputs import Signals

_STATE = int(STATE)
_RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)
_FWDINV = int(mujoco.mjtEnableBit.mjENBL_FWDINV)
INPUTS = ("ctrl", "xfrc_applied", "mocap_pos", "mocap_quat")


class StepEvent(IntEnum):
    """Event since the last step; the kernel has the same numbers."""

    SAME = 0
    NEVER = 1  # there was no step and no start
    ELSEWHERE = 2  # another time
    SET = 3  # another state at the same time
    FULL = 4  # there is no room for another step


@dataclass(frozen=True)
class LoopSteps:
    """The N steps of one episode.

    Attributes:
        state: (N + 1, nstate) time since the start, qpos, qvel and act; row k is before step k.
        rows: (N, width) sensor values, in the scene's layout.
        slots: (1, N, S, 23) contact slots of each pair.
        fields: (N, ...) by name, values of MjData after each step.
        inputs: (N, inputs) in the order of `InitialStates`.
        warnings: (kinds) number of MuJoCo's warnings.
    """

    state: Floats
    rows: Floats
    slots: tuple[Floats, ...]
    fields: Mapping[str, np.ndarray]
    inputs: Floats
    warnings: np.ndarray

    @property
    def is_driven(self) -> bool:
        """True if any external input changed or pushed."""
        pushed = self.fields["xfrc_applied"].any() or self.fields["qfrc_applied"].any()
        return bool(pushed or (self.inputs != self.inputs[0]).any())

    def starts(self, model: mujoco.MjModel) -> InitialStates:
        """Return the start of the episode, and all inputs that changed in it."""
        ends = [1, 1 + model.nq, 1 + model.nq + model.nv]
        _, qpos, qvel, act = np.split(self.state[:1], ends, axis=1)
        inputs = np.split(self.inputs[:1], np.cumsum([model.nu, 6 * model.nbody]), axis=1)
        places = np.flatnonzero((self.inputs != self.inputs[0]).any(axis=0))
        signals = Signals.no_signals()
        if len(places):
            times, levels = self._held_levels(self.inputs[:, places], model).knots
            signals = Signals(places, times[None], levels)
        return InitialStates(qpos, qvel, act, *inputs, signals=(signals,))

    def rollout(self, runs: PreparedRuns) -> Rollout:
        """Return the episode as a rollout of one run, without its cost in time."""
        (model,), count = runs.models, runs.steps
        recorder, controls = Recorder(runs.models, count, 1), self.fields["ctrl"]
        for name, field in recorder.fields.items():
            np.copyto(field, self.fields[name])
        recorder.enter_run(0, 0, model, runs.starts, self.state)
        held_levels = (
            [self._held_levels(controls, model)] if (controls != controls[0]).any() else ()
        )
        arrays = RolloutArrays(self.state[None], self.rows[None], self.fields["solver_niter"][None])
        rollout = completed_rollout(
            arrays, np.full(1, np.nan), self.warnings[None], [None], held_levels
        )
        rollout = replace(recorder.attach_outputs(rollout), slots=self.slots)
        if rollout.work is not None and self.fields["qfrc_applied"].any():
            rollout.work[:, :, OTHERS] = np.nan
        return with_loads(runs, rollout)

    def _held_levels(self, levels: Floats, model: mujoco.MjModel) -> RecordedControls:
        """Return (N, ...) levels of steps, each until the next that differs."""
        change_steps = np.flatnonzero(np.append(True, (np.diff(levels, axis=0) != 0).any(axis=1)))
        times = np.append(change_steps, len(levels)) * model.opt.timestep
        return RecordedControls(times, levels[np.append(change_steps, change_steps[-1])])


class LoopReader:
    """Reads the steps of one MjData into arrays that grow."""

    def __init__(self, base: CompiledScene, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Raise a SceneError for models with sleep; MuJoCo does not keep sleeping contacts."""
        if model.opt.enableflags & PERSISTENT:
            raise SceneError(
                "contacts of sleeping bodies cannot be read; turn the flag `sleep` off"
            )
        self.model, self.data, self._base = model, data, base
        self._arrays = dict[str, np.ndarray]()
        self.clear()

    def clear(self) -> None:
        """Begin an episode and read from the model's current state.

        The next episode overwrites the arrays of the last one, since writes to fresh memory take
        longer.
        """
        forces = EnergyLedger([self.model], 0, 1).forces
        names = (*INPUTS, "qfrc_applied", "solver_niter", *forces)
        self._views = {name: np.asarray(getattr(self.data, name)) for name in names}
        kernel = usable_kernel()
        sizes = 1 + self.model.nq + self.model.nv + self.model.na, _row_width(self._base)
        rows = {"states": np.empty(sizes[0]), "rows": np.empty(sizes[1]), **self._views}
        if _array_kinds(rows) != _array_kinds(
            {name: array[0] for name, array in self._arrays.items()}
        ):
            self._arrays = {
                name: np.empty((1, *row.shape), row.dtype) for name, row in rows.items()
            }
        task = self._base, self.model, self.data, self._views
        self._steps = _KernelSteps(*task, kernel) if kernel else _PlainSteps(*task)
        self.look, self.start = self._steps.look, self._steps.start
        self.read_step = self._steps.read_step
        self._splits = self.model.opt.integrator == _RK4
        self._read = self._steps.read_left if self._splits else self.read_step
        self._warned, self._warnings = (
            self._warning_counts(),
            np.zeros(len(self._warning_counts()), np.int64),
        )
        first_step_count = 1024
        if self.room < first_step_count:
            self.grow(first_step_count)
        self._steps.into(self._arrays)

    @property
    def steps(self) -> int:
        """Number of steps read."""
        return self._steps.count()

    @property
    def room(self) -> int:
        """Number of steps that fit."""
        return len(self._arrays["rows"]) - 1

    def grow(self, room: int) -> None:
        """Make room for at least a number of steps."""
        last = self._arrays
        self._arrays = {
            name: np.empty((room + 1, *array.shape[1:]), array.dtype)
            for name, array in last.items()
        }
        for name, array in last.items():
            self._arrays[name][: len(array)] = array
        self._steps.into(self._arrays)

    @property
    def is_large(self) -> bool:
        """True if twice as many steps would take more than 1 GiB."""
        most_bytes = 1 << 30
        return 2 * sum(array.nbytes for array in self._arrays.values()) > most_bytes

    @property
    def time(self) -> float:
        """The time after the last step [s]."""
        return float(self._arrays["states"][self.steps, 0])

    def make_steps(self, count: int) -> None:
        """Make steps as `mj_step` does, and read each."""
        model, data, read_step = self.model, self.data, self._read
        make = self._make_split_step if self._splits else mj_step
        if count == 1:
            make(model, data)
            read_step()
            return
        if self.steps + count > self.room:
            self.grow(2 * (self.room + count))
        for _ in range(count):
            make(model, data)
            read_step()

    def _make_split_step(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Make a step and read its start's contacts before the last stage of RK4 replaces them."""
        mujoco.mj_checkPos(model, data)
        mujoco.mj_checkVel(model, data)
        mujoco.mj_forward(model, data)
        mujoco.mj_checkAcc(model, data)
        if model.opt.enableflags & _FWDINV:
            mujoco.mj_compareFwdInv(model, data)
        self._steps.read_acting()
        mujoco.mj_RungeKutta(model, data, 4)

    def _warning_counts(self) -> np.ndarray:
        return np.array(self.data.warning.number, np.int64)

    def take_steps(self, set_steps: Sequence[int]) -> LoopSteps:
        """Return the episode so far; raise a MemoryError if there was too little memory.

        Code set the state before each of `set_steps`. MuJoCo normalizes quaternions in such
        states, and so does the record.
        """
        count, slots = self.steps, self._steps.slots()
        fields = {name: self._arrays[name][:count] for name in self._views}
        states = self._arrays["states"][: count + 1].copy()
        states[:, 0] -= states[0, 0]
        for place in quaternion_indices(self.model):
            part = states[:, 1 + place : 5 + place]
            norms = np.linalg.norm(part[[*set_steps]], axis=1, keepdims=True)
            part[[*set_steps]] /= np.where((norms > 0) & (np.abs(norms - 1) > ROUNDING), norms, 1)
        inputs = np.concatenate([fields[name].reshape(count, -1) for name in INPUTS], axis=1)
        warned = self._warning_counts()
        # A reset cleared the counts.
        warnings = np.where(warned < self._warned, warned, warned - self._warned)
        return LoopSteps(states, self._arrays["rows"][:count], slots, fields, inputs, warnings)


def _array_kinds(rows: Mapping[str, np.ndarray]) -> dict[str, object]:
    return {name: (row.shape, row.dtype) for name, row in rows.items()}


def _row_width(base: CompiledScene) -> int:
    return base.layout.lengths + base.model.ntendon


class _PlainSteps:
    """Reads steps without the kernel, to the same bits."""

    def __init__(
        self,
        base: CompiledScene,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        views: Mapping[str, np.ndarray],
    ) -> None:
        self._model, self._data, self._views, self._free = model, data, views, base.free
        holding = base.holding
        names = (holding.subject, holding.holder) if holding else ()
        self._bodies = [require_id(model, "body", name) for name in names]
        pairs = [(pair.bodies, *_side_ids(model, pair), pair.slots) for pair in base.pairs]
        self._pairs = np.array(pairs, np.int64).reshape(-1, 4)
        self._filled = [list[Floats]() for _ in pairs]
        self._count, self._begun = 0, False

    def count(self) -> int:
        """Return the number of steps read."""
        return self._count

    def into(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Set the arrays to write into, by step."""
        self._arrays = arrays

    def look(self) -> int:
        """Return the event since the last step."""
        last = self._arrays["states"][self._count]
        now = np.empty_like(last)
        mujoco.mj_getState(self._model, self._data, now, _STATE)
        if not self._begun:
            return StepEvent.NEVER
        if now[0] != last[0]:
            return StepEvent.ELSEWHERE
        if now.tobytes() != last.tobytes():
            return StepEvent.SET
        return StepEvent.SAME if self._count < len(self._arrays["rows"]) - 1 else StepEvent.FULL

    def start(self) -> None:
        """Read the initial state of the next step."""
        self._begun = True
        state = self._arrays["states"][self._count]
        mujoco.mj_getState(self._model, self._data, state, _STATE)

    def read_step(self) -> None:
        """Read a finished step that kept its contacts and forces."""
        self.read_acting()
        self.read_left()

    def read_left(self) -> None:
        """Read the results of a finished step."""
        for name, view in self._views.items():
            self._arrays[name][self._count] = view
        self._count += 1
        self.start()

    def read_acting(self) -> None:
        """Read contacts and sensor values of a step at its start."""
        model, data, own = self._model, self._data, self._data.energy.copy()
        moved, start = (data.qpos.copy(), data.qvel.copy()), self._arrays["states"][self._count, 1:]
        data.qpos[:], data.qvel[:] = np.split(start[: model.nq + model.nv], [model.nq])
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        nearest = data.contact.dist.min() if data.ncon else 0.0
        parts = [[data.ncon, nearest], data.energy[::-1].copy()]
        data.energy[:], data.qpos[:], data.qvel[:] = own, *moved
        if self._free:
            mujoco.mj_subtreeVel(model, data)
            parts += data.subtree_linvel[0], data.subtree_angmom[0]
        if self._bodies:
            subject, holder = self._bodies
            between = np.empty(3)
            apart = data.xpos[subject] - data.xpos[holder]
            mujoco.mju_mulMatTVec3(between, data.xmat[holder], apart)
            parts += between, data.xquat[holder]
        row = np.concatenate([*parts, data.actuator_force, data.ten_length])
        self._arrays["rows"][self._count] = row
        contact_values = measure_contacts(model, data) if data.ncon else None
        for filled, pair in zip(self._filled, self._pairs, strict=True):
            filled.append(np.zeros((pair[3], SLOT_WIDTH)))
            if contact_values is not None:
                fill_pair(model, data, pair[:3], contact_values, filled[-1])

    def slots(self) -> tuple[Floats, ...]:
        """Return (1, N, S, 23) the slots of each pair; raise a MemoryError if some were lost."""
        return tuple(np.array(array)[None] for array in self._filled)


class _KernelSteps(_PlainSteps):
    """Reads steps by the kernel: one call before each, and one after it."""

    def __init__(
        self,
        base: CompiledScene,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        views: Mapping[str, np.ndarray],
        kernel: Kernel,
    ) -> None:
        super().__init__(base, model, data, views)
        self._kernel, self._kept = kernel, np.empty(model.nq + model.nv)
        sizes = len(self._pairs), _row_width(base), base.free, *(self._bodies or (-1, -1))
        self._handle: int | None = kernel.open_loop(self._pairs.ctypes.data, *sizes)
        if not self._handle:
            raise MemoryError
        task = self._handle, model._address, data._address
        self.look, self.start = partial(kernel.look, *task), partial(kernel.start_step, *task)
        self.read_acting = partial(kernel.read_acting, *task)
        self.read_left = partial(kernel.read_left, *task)
        self.read_step = partial(kernel.read_step, *task)

    def __del__(self) -> None:
        self._kernel.close_recording(self._handle)

    def count(self) -> int:
        """Return the number of steps read."""
        return self._kernel.steps_of(self._handle)

    def into(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Set the arrays to write into, by step."""
        self._arrays = arrays
        fields = [(arrays[name], view) for name, view in self._views.items()]
        addresses = [(array.ctypes.data, view.ctypes.data, view.nbytes) for array, view in fields]
        self._fields = np.array(addresses, np.int64)
        whole = arrays["states"], arrays["rows"], self._kept
        room, count = len(arrays["rows"]) - 1, len(fields)
        loop = [*(array.ctypes.data for array in whole), room, count, self._fields.ctypes.data]
        self._kernel.set_loop(self._handle, np.array(loop, np.int64).ctypes.data)

    def slots(self) -> tuple[Floats, ...]:
        """Return (1, N, S, 23) the slots of each pair; raise a MemoryError if some were lost."""
        if not self._handle or not self._kernel.end_loop(self._handle):
            raise MemoryError
        sizes = len(self._pairs), 1, self.count()
        recorded = recorded_slots(self._kernel, self._handle, sizes, self)
        # Further steps may need this memory.
        return tuple(array.copy() if array.strides[1] else array for array in recorded)


def _side_ids(model: mujoco.MjModel, pair: MonitoredPair) -> list[int]:
    sides = zip(pair.sides, pair.geoms, strict=True)
    return [require_id(model, "body", name) if pair.bodies else own[0] for name, own in sides]
