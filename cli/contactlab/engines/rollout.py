"""Native rollouts: n models of one structure, N steps each, without a Python step loop."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np

from contactlab.contact import Floats
from contactlab.engines.stepping import Batch, SimulationError
from contactlab.scene import InitialStates, has_batch

_ISLANDS = 20


@dataclass(frozen=True)
class Arrays:
    """Where one call records; see `Rollout` for shapes."""

    state: Floats
    sensors: Floats
    iterations: np.ndarray


@dataclass
class Buffers:
    """One block of memory for each kind of record, grown to the largest call."""

    _floats: Floats = field(default_factory=lambda: np.empty(0))
    _integers: np.ndarray = field(default_factory=lambda: np.empty(0, np.int32))

    def arrays(self, model: mujoco.MjModel, runs: int, steps: int) -> Arrays:
        """Return arrays for n runs of N steps; they share memory with those of the last call."""
        width = 1 + model.nq + model.nv + model.na
        state, sensors = runs * (steps + 1) * width, runs * steps * model.nsensordata
        if len(self._floats) < state + sensors:
            self._floats = np.empty(state + sensors)
        if len(self._integers) < runs * steps * _ISLANDS:
            self._integers = np.empty(runs * steps * _ISLANDS, np.int32)
        return Arrays(
            state=self._floats[:state].reshape(runs, steps + 1, width),
            sensors=self._floats[state : state + sensors].reshape(runs, steps, model.nsensordata),
            iterations=self._integers[: runs * steps * _ISLANDS].reshape(runs, steps, _ISLANDS),
        )


def bytes_of_run(model: mujoco.MjModel, steps: int) -> int:
    """Return the memory that one run of N steps records into [bytes]."""
    width = 1 + model.nq + model.nv + model.na + model.nsensordata
    return 8 * width * (steps + 1) + 4 * _ISLANDS * steps


STATE = (
    mujoco.mjtState.mjSTATE_TIME
    | mujoco.mjtState.mjSTATE_QPOS
    | mujoco.mjtState.mjSTATE_QVEL
    | mujoco.mjtState.mjSTATE_ACT
)
_CONTROL = mujoco.mjtState.mjSTATE_CTRL.value
_APPLIED = mujoco.mjtState.mjSTATE_XFRC_APPLIED.value
_PERSISTENT = sum(
    int(getattr(mujoco.mjtEnableBit, name, 0)) for name in ("mjENBL_SLEEP", "mjENBL_IPC")
)
# A warning's record is where it was last raised and how often.
_COUNT = 1


@dataclass(frozen=True)
class Rollout:
    """What the engine returned for n runs of N steps; rows after a run's stop are not valid.

    Attributes:
        state: (n, N + 1, nstate) time, qpos, qvel, act; row k is the state before step k.
        sensors: (n, N, nsensordata) row k belongs to step k.
        iterations: (n, N, islands) solver iterations.
        steps: steps that each run really made.
        cost: (n,) thread CPU time of the stepping [s]; NaN where it is not the engine's alone.
        warnings: engine warnings of each run by name, with their counts.
        errors: the engine's error of each run, or None.
    """

    state: Floats
    sensors: Floats
    iterations: np.ndarray
    steps: tuple[int, ...]
    cost: Floats
    warnings: tuple[dict[str, int], ...]
    errors: tuple[str | None, ...]


def start_batch(models: Sequence[mujoco.MjModel], starts: InitialStates) -> Batch:
    """Return a batch of one thread, each run on its own model and at its start."""
    persistent = any(model.opt.enableflags & _PERSISTENT for model in models)
    batch = Batch(models[0], len(models), 1, persistent=persistent)
    batch.set_models(list(models))
    # A batch starts all runs as its first model does, down to places of mocap bodies and welds.
    batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE.value)
    batch.bind("qpos")[:] = starts.qpos
    batch.bind("qvel")[:] = starts.qvel
    batch.bind("ctrl")[:] = starts.ctrl
    batch.bind("xfrc_applied")[:] = starts.applied.reshape(len(models), -1, 6)
    batch.bind("act")[:] = starts.act
    return batch


def driven(
    model: mujoco.MjModel, starts: InitialStates, run: int, steps: int, first: float = 0
) -> dict[str, Any]:
    """Return what a batch's rollout is told of inputs that change; nothing if none does."""
    if not starts.driven.size:
        return {}
    inputs = starts.inputs(run, model.opt.timestep, first + np.arange(steps))
    if starts.driven.max() < model.nu:
        return {"control": inputs[None, :, : model.nu], "control_spec": _CONTROL}
    return {"control": inputs[None], "control_spec": _CONTROL | _APPLIED}


def roll_out(
    models: Sequence[mujoco.MjModel],
    starts: InitialStates,
    steps: int,
    buffers: Buffers,
    watch: Callable[[], None] = lambda: None,
    proceed: Callable[[], bool] = lambda: True,
) -> Rollout:
    """Step every run by itself on this thread, so that its CPU time is its own.

    Bit for bit equal to a loop over `mj_step` for each run.

    Args:
        models: (n) compiled models of one layout; automatic reset must be off.
        starts: where the runs start, and what acts on them throughout.
        steps: N.
        buffers: memory to record into; its arrays are overwritten by the next call.
        watch: called before each run, to start its time limit.
        proceed: asked between runs; if it says no, the rollout has only the first of them.
    """
    count = len(models)
    batch = start_batch(models, starts)
    arrays = buffers.arrays(models[0], count, steps)
    velocity = 1 + models[0].nq
    arrays.state[:, 0] = 0.0
    arrays.state[:, 0, 1:velocity] = starts.qpos
    activation = velocity + models[0].nv
    arrays.state[:, 0, velocity:activation] = starts.qvel
    arrays.state[:, 0, activation:] = starts.act
    cost = np.zeros(count)
    errors: list[str | None] = [None] * count
    for run in range(count):
        if run and not proceed():
            count = run
            break
        out: dict[Any, np.ndarray] = {
            int(STATE): arrays.state[run : run + 1, 1:],
            "sensordata": arrays.sensors[run : run + 1],
            "solver_niter": arrays.iterations[run : run + 1],
        }
        programme = driven(models[run], starts, run, steps)
        watch()
        start = time.thread_time()
        try:
            batch.rollout(steps, record=list(out), ids=[run], out=out, **programme)
        except SimulationError:
            errors[run] = batch.error(run)
            _blank(arrays, run)
        cost[run] = time.thread_time() - start
    made = tuple(
        0 if errors[run] else _valid_steps(arrays.state[run, :, 0]) for run in range(count)
    )
    if not has_batch():
        cost = np.array([_native_cost(models[run], starts, run, made[run]) for run in range(count)])
    return Rollout(
        state=arrays.state[:count],
        sensors=arrays.sensors[:count],
        iterations=arrays.iterations[:count],
        steps=made,
        cost=cost[:count],
        warnings=tuple(_warnings(batch.warning[run, :, _COUNT]) for run in range(count)),
        errors=tuple(errors[:count]),
    )


def _native_cost(model: mujoco.MjModel, starts: InitialStates, run: int, steps: int) -> float:
    """Return what a run's steps take without Python between them: made again, unrecorded."""
    if starts.driven.size:
        return np.nan
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = starts.qpos[run], starts.qvel[run], starts.ctrl[run]
    data.xfrc_applied[:], data.act[:] = starts.applied[run].reshape(-1, 6), starts.act[run]
    begin = time.thread_time()
    if steps:
        mujoco.mj_step(model, data, nstep=steps)
    return time.thread_time() - begin


def _blank(arrays: Arrays, run: int) -> None:
    """Leave nothing of an earlier call in the rows that a failed run did not write."""
    arrays.state[run, 1:] = arrays.state[run, 0]
    arrays.sensors[run] = 0.0
    arrays.iterations[run] = 0


def _valid_steps(clock: Floats) -> int:
    """Return how many steps the clock grew; a stopped run repeats its last record."""
    stuck = np.flatnonzero(np.diff(clock) <= 0)
    return int(stuck[0]) if len(stuck) else len(clock) - 1


def _warnings(counts: np.ndarray) -> dict[str, int]:
    return {
        mujoco.mjtWarning(kind).name.removeprefix("mjWARN_").lower(): int(counts[kind])
        for kind in np.flatnonzero(counts)
    }
