"""Contacts without contact sensors: a kernel in C, compiled on first use, that MuJoCo calls.

A contact sensor compares its pair with every contact of every step, and its slots are copied even
where they are empty. `contact_kernel.c` looks up the pair of each contact instead and keeps what it
finds, bit for bit what sensors measure. It is MuJoCo's sensor callback, which batches call in each
step without Python, so that controls, warnings and errors stay theirs.

Nothing needs it: without a compiler, where a model is such that sensors say more, or with the
variable CONTACTLAB_KERNEL=off, sensors record as they always did.
"""

import ctypes
import hashlib
import importlib.util
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import FOUND, SLOT_WIDTH, Floats
from contactlab.engines.engine import Buffers, Proceed, Rollout, Watch, no_limit, proceed_always
from contactlab.engines.mujoco_batch import PERSISTENT, roll_out
from contactlab.errors import KernelWarning
from contactlab.resources import user_cache
from contactlab.scene.compile_model import PREFIX
from contactlab.scene.initial_states import InitialStates
from contactlab.scene.mujoco_versions import VERSION, library_file

_SWITCH = "CONTACTLAB_KERNEL"
_SOURCE = Path(__file__).with_suffix(".c")
_FLAGS = ("-std=c11", "-O2", "-fPIC", "-shared", "-ffp-contract=off")
_MOST_SECONDS = 120  # A compiler that takes longer hangs.
_OTHERS_WRITE = 0o022
_CHECKED_STEPS = 64  # after the first contact of a run that is compared with sensors
_CONTACT, _USER = int(mujoco.mjtSensor.mjSENS_CONTACT), int(mujoco.mjtSensor.mjSENS_USER)
_BODY = int(mujoco.mjtObj.mjOBJ_BODY)
_NEVER, _LAST = int(mujoco.mjtStage.mjSTAGE_NONE), int(mujoco.mjtStage.mjSTAGE_ACC)
_NO_SENSORS = int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
_POINTER, _INT = ctypes.c_void_p, ctypes.c_int


class KernelError(Exception):
    """The kernel cannot be had or does not do what sensors do; the message says why."""


@dataclass
class Kernel:
    """The loaded kernel: whether it was compared with sensors in this process, and failed."""

    library: ctypes.CDLL
    checked: bool = False
    failed: bool = False


def roll_out_by_kernel(
    models: Sequence[mujoco.MjModel],
    starts: InitialStates,
    steps: int,
    buffers: Buffers,
    watch: Watch = no_limit,
    proceed: Proceed = proceed_always,
) -> Rollout:
    """Step runs as `roll_out` does, contacts from the kernel where there is one and it may.

    The first run of a process that has contacts is compared with what sensors give.
    """
    kernel = None if os.environ.get(_SWITCH) == "off" else load_kernel()
    if kernel is None or kernel.failed or not all(map(_may_read, models)):
        return roll_out(models, starts, steps, buffers, watch, proceed)
    try:
        with _recording(kernel.library, models[0], steps, len(models)) as contacts:
            with contacts.in_place_of_sensors(models):
                rollout = roll_out(
                    models, starts, steps, buffers, watch, proceed, contacts=contacts
                )
            contacts.check_times(rollout)
            rollout = replace(rollout, slots=contacts.slots(len(rollout.steps), buffers))
            kernel.checked = kernel.checked or contacts.agree(models, starts, rollout)
    except KernelError as error:
        kernel.failed = True
        warnings.warn(f"contacts are read by sensors from now on: {error}", KernelWarning, 2)
        return roll_out(models, starts, steps, buffers, watch, proceed)
    return rollout


def _may_read(model: mujoco.MjModel) -> bool:
    """Return whether a model's contacts may come from the kernel.

    What sleeps keeps its slots from before; and a callback is for sensors that are on.
    """
    return not (model.opt.enableflags & PERSISTENT or model.opt.disableflags & _NO_SENSORS)


class ContactRecording:
    """Contacts of n runs of N steps of one structure, from where their models have sensors."""

    def __init__(self, library: ctypes.CDLL, model: mujoco.MjModel, steps: int, runs: int) -> None:
        """Make room for rows of what sensors measure from the count of all contacts on."""
        first = self._all = model.sensor(f"{PREFIX}contacts").id
        while first and model.sensor_type[first - 1] == _CONTACT:
            if not model.sensor(first - 1).name.startswith(PREFIX):
                break
            first -= 1
        self._library, self._steps = library, steps
        self._pairs = pairs = slice(first, self._all)
        of_bodies = model.sensor_objtype[pairs] == _BODY
        sides = model.sensor_objid[pairs], model.sensor_refid[pairs]
        most = model.sensor_dim[pairs] // SLOT_WIDTH
        # As `key_of` in C has them.
        self._order = np.lexsort([np.maximum(*sides), np.minimum(*sides), of_bodies])
        table = np.stack([of_bodies, *sides, most], axis=1)[self._order].astype(np.int32)
        address = int(model.sensor_adr[self._all])
        self.width = model.nsensordata - address
        self._times, self._made = np.empty((runs, steps)), [0] * runs
        self.handle = library.open_recording(
            len(table), np.ascontiguousarray(table).ctypes.data, steps, address, self.width
        )
        if not self.handle:
            raise MemoryError

    @contextmanager
    def in_place_of_sensors(self, models: Sequence[mujoco.MjModel]) -> Generator[None]:
        """Switch off the sensors of pairs; the one of all contacts calls the kernel instead."""
        written = models[0].sensor_needstage.copy()
        stages = written.copy()
        stages[self._pairs], stages[self._all] = _NEVER, _LAST
        try:
            for model in models:
                model.sensor_needstage[:], model.sensor_type[self._all] = stages, _USER
            yield
        finally:
            for model in models:
                model.sensor_needstage[:], model.sensor_type[self._all] = written, _CONTACT

    @contextmanager
    def of_run(self, run: int, rows: Floats) -> Generator[None]:
        """Record what is stepped meanwhile as a run, into rows (N, width), unless it fails."""
        times = self._times[run]
        if not self._library.begin_run(self.handle, run, rows.ctypes.data, times.ctypes.data):
            raise KernelError("another sensor callback is installed")
        keep = False
        try:
            yield
            keep = True
        finally:
            made = self._made[run] = self._library.end_run(self.handle, keep)
            # What a stopped run did not write is not valid, but must be numbers.
            rows[max(made, 0) :] = rows[made - 1] if made > 0 else 0.0
        if made < 0:
            raise MemoryError

    def check_times(self, rollout: Rollout) -> None:
        """Raise a KernelError unless each step was recorded once, as it began."""
        for run, steps in enumerate(rollout.steps):
            began = np.array_equal(self._times[run, :steps], rollout.state[run, :steps, 0])
            if not rollout.errors[run] and not (began and self._made[run] <= self._steps):
                raise KernelError("MuJoCo did not call it once in each step")

    def slots(self, runs: int, buffers: Buffers) -> tuple[Floats, ...]:
        """Return slots of each pair, as many as some step of these runs fills, but one at least."""
        widths = np.zeros(len(self._order), np.int32)
        self._library.find_widths(self.handle, widths.ctypes.data)
        ends = np.cumsum(runs * self._steps * widths.astype(np.int64))
        places = np.concatenate(([0], ends[:-1]))
        slots = buffers.zeros(int(ends.max(initial=0)), SLOT_WIDTH)
        self._library.fill_slots(
            self.handle, widths.ctypes.data, places.ctypes.data, slots.ctypes.data
        )
        found = [np.broadcast_to(np.zeros(SLOT_WIDTH), (runs, self._steps, 1, SLOT_WIDTH))]
        found *= len(widths)
        for row in np.flatnonzero(widths).tolist():
            part = slots[places[row] : ends[row]]
            found[self._order[row]] = part.reshape(runs, self._steps, -1, SLOT_WIDTH)
        return tuple(found)

    def agree(
        self, models: Sequence[mujoco.MjModel], starts: InitialStates, rollout: Rollout
    ) -> bool:
        """Return whether there are contacts, and raise a KernelError if sensors see others."""
        assert rollout.slots is not None
        touching = [each[:, :, 0, FOUND] > 0 for each in rollout.slots if each.strides[0]]
        for run, step in np.argwhere(np.logical_or.reduce(touching))[:1].tolist():
            stop = min(step + _CHECKED_STEPS, rollout.steps[run])
            model, slots = models[run], [each[run, :stop] for each in rollout.slots]
            expected = roll_out([model], starts.pick(run), stop, Buffers())
            sensors = expected.sensors[0]
            full = np.zeros_like(sensors)
            full[:, -self.width :] = rollout.sensors[run, :stop]
            for address, each in zip(model.sensor_adr[self._pairs].tolist(), slots, strict=True):
                full[:, address : address + each[0].size] = each.reshape(stop, -1)
            own = int(model.sensor_adr[self._pairs.start])
            state = rollout.state[run, : stop + 1].tobytes() == expected.state[0].tobytes()
            if not state or full[:, own:].tobytes() != sensors[:, own:].tobytes():
                raise KernelError(f"it disagrees with them in a run of {stop} steps")
            return True
        return False


@contextmanager
def _recording(
    library: ctypes.CDLL, model: mujoco.MjModel, steps: int, runs: int
) -> Generator[ContactRecording]:
    recording = ContactRecording(library, model, steps, runs)
    try:
        yield recording
    finally:
        library.close_recording(recording.handle)


@cache
def load_kernel() -> Kernel | None:
    """Return the kernel, compiled if it is not in the user's cache; None if it cannot be had."""
    try:
        library = ctypes.CDLL(str(compiled_kernel()))
    except (KernelError, OSError):
        return None
    library.open_recording.restype = _POINTER
    library.open_recording.argtypes = _INT, _POINTER, _INT, _INT, _INT
    library.begin_run.argtypes = _POINTER, _INT, _POINTER, _POINTER
    library.end_run.argtypes = _POINTER, _INT
    library.find_widths.argtypes = _POINTER, _POINTER
    library.fill_slots.argtypes = _POINTER, _POINTER, _POINTER, _POINTER
    library.close_recording.argtypes = (_POINTER,)
    return Kernel(library)


def compiled_kernel(*flags: str) -> Path:
    """Return the kernel as a shared library, compiled with more flags unless it is in the cache.

    A KernelError says why there is none: no compiler, or one that fails, or a cache of others.
    """
    command = [*_FLAGS, *flags, str(_SOURCE), f"-I{library_file().parent / 'include'}"]
    key = hashlib.sha256(_SOURCE.read_bytes())
    key.update("\0".join([VERSION, platform.platform(), *command]).encode())
    folder = user_cache()
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if folder.stat().st_uid != os.geteuid() or folder.stat().st_mode & _OTHERS_WRITE:
        raise KernelError(f"others may write to {folder}")
    target = folder / f"kernel-{VERSION}-{key.hexdigest()[:12]}.so"
    if target.exists():
        return target
    # Two processes may compile it at once; each replaces the file as a whole.
    handle, name = tempfile.mkstemp(dir=folder, suffix=".so")
    os.close(handle)
    try:
        _compile([*command, str(library_file()), "-o", name])
        return Path(name).replace(target)
    finally:
        Path(name).unlink(missing_ok=True)


def _compile(arguments: list[str]) -> None:
    """Run the first compiler that works."""
    found = [shlex.split(os.environ.get("CC", ""))]
    found += [[each] for each in (shutil.which("cc"),) if each]
    if importlib.util.find_spec("ziglang"):
        found.append([sys.executable, "-m", "ziglang", "cc"])
    said = "no C compiler: there is no cc, and no ziglang"
    for compiler in filter(None, found):
        try:
            done = subprocess.run(  # noqa: S603 - the user's own compiler
                [*compiler, *arguments],
                check=False,
                capture_output=True,
                text=True,
                timeout=_MOST_SECONDS,
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            said = f"{compiler[0]}: {error}"
            continue
        if not done.returncode:
            return
        said = f"{compiler[0]}: {done.stderr.strip().splitlines()[:1]}"
    raise KernelError(said)
