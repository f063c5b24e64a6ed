"""Runs without contact sensors: a kernel in C, compiled on first use, steps and reads contacts.

A contact sensor compares its pair with every contact of every step, and its slots are copied even
if they are empty. `contact_kernel.c` looks up the pair of each contact instead and keeps the
result, bit for bit like sensors. It steps within MuJoCo's batch; the alternative, a sensor
callback, makes MuJoCo compute unneeded accelerations of bodies in each step.

Without a compiler, under policies, for sleeping bodies and with CONTACTLAB_KERNEL=off, sensors
record.
"""

import ctypes
import warnings
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import FOUND, SLOT_WIDTH, Floats
from contactlab.disk_arrays import disk_memory_in_use
from contactlab.engines.engine import Buffers, PreparedRuns, Proceed, Rollout, Watch
from contactlab.engines.mujoco_batch import PERSISTENT, STATE, BatchStepper, roll_out
from contactlab.engines.step_work import FORCES
from contactlab.errors import CompilerError, EngineError
from contactlab.native import compile_library, is_wanted
from contactlab.scene.compile_model import SENSOR_PREFIX
from contactlab.scene.mujoco_versions import VERSION, has_batch, library_file

_KERNEL_SOURCE = Path(__file__).with_suffix(".c")
_SENSORS_OFF = int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
_POINTER_TYPE, _INT_TYPE = ctypes.c_void_p, ctypes.c_int


class Kernel(ctypes.CDLL):
    """The loaded kernel: whether it was compared with sensors in this process, and failed."""

    checked = failed = False

    def __init__(self) -> None:
        super().__init__(str(compiled_kernel()))
        self.open_recording.restype, self.record_run.restype = _POINTER_TYPE, ctypes.c_char_p
        self.open_recording.argtypes = _POINTER_TYPE, *[_INT_TYPE] * 4
        self.record_run.argtypes = _POINTER_TYPE, _POINTER_TYPE
        self.slot_bytes.restype, self.slot_bytes.argtypes = (
            ctypes.c_size_t,
            (_POINTER_TYPE, _INT_TYPE),
        )
        self.find_slots.argtypes = _POINTER_TYPE, _INT_TYPE, _POINTER_TYPE, _POINTER_TYPE
        self.set_memory.argtypes = _POINTER_TYPE, _POINTER_TYPE
        self.close_recording.argtypes = self.end_loop.argtypes = (_POINTER_TYPE,)
        self.open_loop.restype, self.open_loop.argtypes = (
            _POINTER_TYPE,
            (_POINTER_TYPE, *[_INT_TYPE] * 5),
        )
        self.set_loop.argtypes, self.steps_of.argtypes = (_POINTER_TYPE,) * 2, (_POINTER_TYPE,)
        for function in (
            self.look,
            self.start_step,
            self.read_acting,
            self.read_left,
            self.read_step,
        ):
            function.argtypes = (_POINTER_TYPE,) * 3


def roll_out_by_kernel(
    runs: PreparedRuns, buffers: Buffers, watch: Watch, proceed: Proceed
) -> Rollout:
    """Step runs like `roll_out`, with contacts from the kernel if it is available and allowed.

    The first run of a process that has contacts is compared with the result of sensors.
    """
    models, starts, steps = runs.models, runs.starts, runs.steps
    kernel = usable_kernel()
    # Sleeping bodies keep their earlier slots.
    flags = (
        model.opt.enableflags & PERSISTENT | model.opt.disableflags & _SENSORS_OFF
        for model in models
    )
    if kernel is None or any(flags):
        return roll_out(models, starts, steps, buffers, watch, proceed)
    if disk := disk_memory_in_use():
        # Slots of long runs lie in files, like NumPy's arrays.
        kernel.set_memory(*disk.functions)
    contacts = KernelStepper(kernel, runs)
    rollout = roll_out(models, starts, steps, buffers, watch, proceed, stepper=contacts)
    rollout = replace(rollout, slots=contacts.slots(len(rollout.steps)))
    try:
        kernel.checked = kernel.checked or _agrees_with_sensors(runs, rollout)
    except EngineError as error:
        kernel.failed = True
        warnings.warn(f"contacts are read by sensors from now on: {error}", stacklevel=2)
        return roll_out(models, starts, steps, buffers, watch, proceed)
    return rollout


class KernelStepper(BatchStepper):
    """Steps runs of one structure, and keeps their contacts."""

    def __init__(self, library: Kernel, runs: PreparedRuns) -> None:
        """Raise a MemoryError if there is not enough memory."""
        self._library, self._models, starts = library, runs.models, runs.starts
        self._pairs, self._steps, model = len(runs.base.pairs), runs.steps, runs.base.model
        first = model.sensor(f"{SENSOR_PREFIX}contacts").id - self._pairs
        self.width = model.nsensordata - runs.base.layout.contacts
        self.warnings = np.zeros((len(self._models), int(mujoco.mjtWarning.mjNWARNING)), np.int32)
        begin = starts.qpos, starts.qvel, starts.ctrl, starts.applied, starts.act
        self._rows = [*map(np.ascontiguousarray, begin), self.warnings]
        # Addresses for the first run, with the distance to those of the next; looked up once.
        self._addresses = [(row.ctypes.data, row.strides[0]) for row in self._rows]
        sizes = self._pairs, len(self._models), runs.steps
        # Use a run's own model, because the scene's may have flags that a run turns off: sleeping
        # models have no batch.
        self._handle = library.open_recording(self._models[0]._address, first, *sizes)
        if not self._handle:
            raise MemoryError

    def __del__(self) -> None:
        self._library.close_recording(self._handle)

    def bytes_beside(self, runs: int) -> int:
        """Return the memory [bytes] of the slots of `runs` runs at their current width."""
        return self._library.slot_bytes(self._handle, runs)

    def step_run(self, run: int, inputs: Mapping[str, Any], out: Mapping[Any, np.ndarray]) -> str:
        """Make a run, and record it like a batch. Return the error, if any."""
        control = np.ascontiguousarray(inputs.get("control", np.empty((1, 0, 0))))
        *arrays_at, warned = (first + run * stride for first, stride in self._addresses)
        arrays = control, out[STATE], out["sensordata"], out["solver_niter"], *map(out.get, FORCES)
        addresses = [0 if array is None else array.ctypes.data for array in arrays]
        numbers = warned, run, inputs.get("control_spec", 0), control.shape[2]
        task = np.array([self._models[run]._address, *arrays_at, *addresses, *numbers])
        error = self._library.record_run(self._handle, task.ctypes.data)
        if error == b"out of memory":
            raise MemoryError
        return error.decode() if error else ""

    def slots(self, runs: int) -> tuple[Floats, ...]:
        """Return slots of each pair, as many as any step of these runs fills, but at least one."""
        sizes = self._pairs, runs, self._steps
        return recorded_slots(self._library, self._handle, sizes, self)


class _RecordingMemory:
    """Numbers in memory of a recording, which lives as long as they do."""

    def __init__(self, owner: object, address: int, shape: tuple[int, ...]) -> None:
        self.owner = owner
        kind = np.dtype(np.float64).str
        interface = {"version": 3, "typestr": kind, "shape": shape, "data": (address, False)}
        self.__array_interface__ = interface


def recorded_slots(
    library: Kernel, handle: int, sizes: tuple[int, int, int], owner: object
) -> tuple[Floats, ...]:
    """Return the slots of a recording, of some pairs in some runs of some steps.

    They are views of its memory, which its owner closes. Raises a MemoryError if there is too
    little.
    """
    pairs, runs, steps = sizes
    widths, addresses = np.zeros(pairs, np.int64), np.zeros(pairs, np.int64)
    if not library.find_slots(handle, runs, addresses.ctypes.data, widths.ctypes.data):
        raise MemoryError
    none = np.broadcast_to(np.zeros(SLOT_WIDTH), (runs, steps, 1, SLOT_WIDTH))
    slots = [none] * pairs
    for pair in np.flatnonzero(widths).tolist():
        shape = runs, steps, int(widths[pair]), SLOT_WIDTH
        slots[pair] = np.asarray(_RecordingMemory(owner, int(addresses[pair]), shape))
    return tuple(slots)


def _agrees_with_sensors(runs: PreparedRuns, rollout: Rollout) -> bool:
    """Return whether there are contacts. Raises an EngineError if sensors see others."""
    assert rollout.slots is not None
    layout = runs.base.layout
    touching = [slot[:, :, 0, FOUND] > 0 for slot in rollout.slots if slot.strides[0]]
    for run, step in np.argwhere(np.logical_or.reduce(touching))[:1].tolist():
        # Steps after the first contact of a run that are compared with sensors.
        stop = min(step + 64, rollout.steps[run])
        expected = roll_out([runs.models[run]], runs.starts.select_run(run), stop, Buffers())
        rows = expected.sensors[0].copy()
        rows[:, layout.pairs[0] : layout.contacts] = 0
        rows[:, layout.contacts :] = rollout.sensors[run, :stop]
        for address, slot in zip(layout.pairs, rollout.slots, strict=True):
            rows[:, address : address + slot[0, 0].size] = slot[run, :stop].reshape(stop, -1)
        same = rows.tobytes() == expected.sensors[0].tobytes()
        if not same or rollout.state[run, : stop + 1].tobytes() != expected.state[0].tobytes():
            raise EngineError(f"the kernel disagrees with them in a run of {stop} steps")
        return True
    return False


def usable_kernel() -> Kernel | None:
    """Return the kernel, unless it is turned off, unavailable, or failed in this process."""
    kernel = load_kernel() if is_wanted() else ""
    return None if isinstance(kernel, str) or kernel.failed else kernel


@cache
def load_kernel() -> Kernel | str:
    """Return the kernel, compiled if it is not in the user's cache, or why it is unavailable."""
    try:
        return Kernel() if has_batch() else ""
    except (CompilerError, OSError) as error:
        return str(error)


def reason_for_sensors() -> str:
    """Return why sensors record instead of a kernel; empty if a kernel does, or is turned off."""
    kernel = load_kernel() if is_wanted() else ""
    return kernel if isinstance(kernel, str) else ""


def compiled_kernel() -> Path:
    """Return the kernel as a shared library.

    Raises a CompilerError with the reason if impossible.
    """
    library = library_file()
    headers = f"-I{library.parent / 'include'}"
    return compile_library(_KERNEL_SOURCE, headers, str(library), version=VERSION)
