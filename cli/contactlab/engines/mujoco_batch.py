"""MuJoCo's rollouts: n models of one structure, N steps each, in batches on one thread."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats, RecordedControls
from contactlab.engines.engine import (
    Buffers,
    Proceed,
    Rollout,
    RolloutArrays,
    Watch,
    bytes_of_run,
    no_limit,
    proceed_always,
)
from contactlab.engines.older_mujoco import SimulationError
from contactlab.engines.passages import Passages
from contactlab.engines.step_work import EnergyLedger
from contactlab.scene.initial_states import InitialStates
from contactlab.scene.mujoco_versions import has_batch

if TYPE_CHECKING or has_batch():
    from mujoco.batch import Batch
else:
    from contactlab.engines.older_mujoco import StepLoop as Batch

STATE = (
    mujoco.mjtState.mjSTATE_TIME
    | mujoco.mjtState.mjSTATE_QPOS
    | mujoco.mjtState.mjSTATE_QVEL
    | mujoco.mjtState.mjSTATE_ACT
)
_CONTROL_SPEC = mujoco.mjtState.mjSTATE_CTRL.value
_APPLIED_SPEC = mujoco.mjtState.mjSTATE_XFRC_APPLIED.value
_MOCAP_SPEC = mujoco.mjtState.mjSTATE_MOCAP_POS.value | mujoco.mjtState.mjSTATE_MOCAP_QUAT.value
PERSISTENT = sum(
    int(getattr(mujoco.mjtEnableBit, name, 0)) for name in ("mjENBL_SLEEP", "mjENBL_IPC")
)
_COUNT_INDEX = 1  # index of the count in a warning's record; the other entry is its last location


def start_batch(models: Sequence[mujoco.MjModel], starts: InitialStates, threads: int = 1) -> Batch:
    """Return a batch, each run with its own model and at its start.

    Runs are the same bit for bit for any number of threads; MuJoCo before 3.17 has one.
    """
    persistent = any(model.opt.enableflags & PERSISTENT for model in models)
    threads = threads if has_batch() else 1
    batch = Batch(models[0], len(models), threads, persistent=persistent)
    batch.set_models(list(models))
    # A batch starts all runs like its first model, including mocap bodies and welds.
    batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE.value)
    batch.bind("qpos")[:] = starts.qpos
    batch.bind("qvel")[:] = starts.qvel
    batch.bind("ctrl")[:] = starts.ctrl
    batch.bind("xfrc_applied")[:] = starts.applied.reshape(len(models), -1, 6)
    batch.bind("act")[:] = starts.act
    return batch


def driven_inputs(
    model: mujoco.MjModel, starts: InitialStates, run: int, steps: int, first: float = 0
) -> dict[str, Any]:
    """Return a batch's arguments for time-dependent inputs; empty if all are constant."""
    places = starts.signals[run].places
    if not places.size:
        return {}
    width, spec = model.nu, _CONTROL_SPEC
    if places.max() >= width:
        width, spec = width + 6 * model.nbody, spec | _APPLIED_SPEC
    if places.max() >= width:
        width, spec = width + 7 * model.nmocap, spec | _MOCAP_SPEC
    inputs = starts.input_rows(run, model.opt.timestep, first + np.arange(steps), width)
    return {"control": inputs[None], "control_spec": spec}


def last_states(
    models: Sequence[mujoco.MjModel], starts: InitialStates, steps: int, threads: int = 1
) -> Floats:
    """Return (n, nq + nv) the states of runs after some steps, unrecorded; NaN after a warning."""
    batch, count = start_batch(models, starts, threads), len(models)
    driving = [driven_inputs(model, starts, run, steps) for run, model in enumerate(models)]
    failed = np.zeros(count, bool)
    for run in range(count) if any(driving) else ():
        try:
            batch.rollout(steps, record=[], ids=[run], **driving[run])
        except SimulationError:
            failed[run] = True
    if not any(driving):
        try:
            batch.rollout(steps, record=[])
        except SimulationError:
            failed |= [bool(batch.error(run)) for run in range(count)]
    ends = np.concatenate([batch.bind("qpos"), batch.bind("qvel")], axis=1)
    ends[failed | batch.warning[:, :, _COUNT_INDEX].any(axis=1)] = np.nan
    return ends


class BatchStepper:
    """Steps runs by a batch, which records all sensors.

    Attributes:
        width: the number of recorded sensor values.
        warnings: (n, kinds) counts of MuJoCo's warnings in each run.
    """

    def __init__(self, models: Sequence[mujoco.MjModel], starts: InitialStates, steps: int) -> None:
        """Prepare runs of N steps."""
        self._batch, self._steps = start_batch(models, starts), steps
        self.width, self.warnings = models[0].nsensordata, self._batch.warning[:, :, _COUNT_INDEX]

    def bytes_beside(self, runs: int) -> int:  # noqa: ARG002 - of those that keep more
        """Return the memory [bytes] of `runs` runs besides the arrays that it records into."""
        return 0

    def step_run(self, run: int, inputs: Mapping[str, Any], out: Mapping[Any, np.ndarray]) -> str:
        """Make a run with inputs from `driven`. Return an error, if any."""
        try:
            self._batch.rollout(self._steps, record=list(out), ids=[run], out=dict(out), **inputs)
        except SimulationError:
            return self._batch.error(run)
        return ""


def roll_out(
    models: Sequence[mujoco.MjModel],
    starts: InitialStates,
    steps: int,
    buffers: Buffers,
    watch: Watch = no_limit,
    proceed: Proceed = proceed_always,
    *,
    stepper: BatchStepper | None = None,
) -> Rollout:
    """Step every run alone on this thread; see `SimulationEngine.roll_out`.

    Bit for bit equal to a loop over `mj_step`. The models are of one layout, without autoreset.
    """
    stepper = stepper or BatchStepper(models, starts, steps)
    size = bytes_of_run(models[0], steps, stepper.width)
    count = min(len(models), max(1, buffers.most // size))
    models, starts = models[:count], starts.select_runs(range(count))
    arrays = buffers.arrays(models[0], count, steps, stepper.width)
    record_starts(starts, arrays)
    cost = np.zeros(count)
    errors: list[str | None] = [None] * count
    recorder = Recorder(models, steps, 1)
    for run in range(count):
        fits = size * (run + 1) + stepper.bytes_beside(run + 1) <= buffers.most
        if run and not (fits and proceed()):
            count = run
            break
        out: dict[Any, np.ndarray] = {
            int(STATE): arrays.state[run : run + 1, 1:],
            "sensordata": arrays.sensors[run : run + 1],
            "solver_niter": arrays.iterations[run : run + 1],
            **recorder.fields,
        }
        inputs = driven_inputs(models[run], starts, run, steps)
        watch()
        start = time.thread_time()
        errors[run] = stepper.step_run(run, inputs, out) or None
        cost[run] = time.thread_time() - start
        if not errors[run]:
            recorder.enter_run(run, 0, models[run], starts, arrays.state[run])
    rollout = completed_rollout(arrays, cost[:count], stepper.warnings[:count], errors)
    return recorder.attach_outputs(rollout)


class Recorder:
    """Records fields of batches besides states, and evaluates them.

    `fields` has arrays (rows, N, ...) by field of MjData, for runs that are recorded together.
    """

    def __init__(self, models: Sequence[mujoco.MjModel], steps: int, rows: int) -> None:
        """Record runs of N steps, `rows` of them together."""
        self._ledger = EnergyLedger(models, steps, rows)
        self._passages = Passages(models[0], len(models))
        self.fields = self._ledger.forces

    def enter_run(
        self, run: int, row: int, model: mujoco.MjModel, starts: InitialStates, states: Floats
    ) -> None:
        """Evaluate a run that was recorded in a row; see `EnergyLedger.enter_run`."""
        with np.errstate(all="ignore"):
            self._ledger.enter_run(run, row, model, starts, states)
            self._passages.enter_run(run, model, starts, states)

    def attach_outputs(self, rollout: Rollout) -> Rollout:
        """Return a rollout with the evaluated results of its runs."""
        count, books = len(rollout.cost), self._ledger
        rollout = replace(rollout, passages=tuple(self._passages.found[:count]))
        if books.work is None or books.given is None:
            return rollout
        return replace(rollout, work=books.work[:count], constraint_gain=books.given[:count])


def record_starts(starts: InitialStates, arrays: RolloutArrays) -> None:
    """Record the state before the first step of each run, at time 0."""
    arrays.state[:, 0, 0] = 0.0
    arrays.state[:, 0, 1:] = np.concatenate([starts.qpos, starts.qvel, starts.act], axis=1)


def completed_rollout(
    arrays: RolloutArrays,
    cost: Floats,
    warnings: np.ndarray,
    errors: Sequence[str | None],
    controls: Sequence[RecordedControls | None] = (),
) -> Rollout:
    """Return the first n recorded runs, with cost (n,) [s] and counts of warnings (n, kinds)."""
    count = len(cost)
    for run in range(count):
        if errors[run]:
            # Clear data of an earlier call from the rows that a failed run did not write.
            arrays.state[run, 1:] = arrays.state[run, 0]
            arrays.sensors[run] = 0.0
            arrays.iterations[run] = 0
    # A stopped run repeats its last time.
    return Rollout(
        *arrays.rows(slice(count)),
        steps=tuple(
            (np.diff(arrays.state[:count, :, 0], append=-np.inf) <= 0).argmax(axis=1).tolist()
        ),
        cost=cost,
        warnings=tuple(map(_warnings_by_name, warnings)) if warnings.any() else ({},) * count,
        errors=tuple(errors[:count]),
        controls=tuple(controls),
    )


def _warnings_by_name(counts: np.ndarray) -> dict[str, int]:
    return {
        mujoco.mjtWarning(kind).name.removeprefix("mjWARN_").lower(): int(counts[kind])
        for kind in np.flatnonzero(counts)
    }
