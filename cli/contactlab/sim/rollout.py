"""Native rollouts: n models of one structure, N steps each, without a Python step loop."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch, SimulationError

from contactlab.sim.buffers import Buffers
from contactlab.trace import Floats

STATE = (
    mujoco.mjtState.mjSTATE_TIME
    | mujoco.mjtState.mjSTATE_QPOS
    | mujoco.mjtState.mjSTATE_QVEL
    | mujoco.mjtState.mjSTATE_ACT
)
_PERSISTENT = mujoco.mjtEnableBit.mjENBL_SLEEP


@dataclass(frozen=True)
class Rollout:
    """What the engine returned for n runs of N steps; rows after a run's stop are not valid.

    Attributes:
        state: (n, N + 1, nstate) time, qpos, qvel, act; row k is the state before step k.
        sensors: (n, N, nsensordata) row k belongs to step k.
        iterations: (n, N, islands) solver iterations.
        steps: steps that each run really made.
        cost: (n,) thread CPU time of the stepping [s].
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


def quiet() -> None:
    """Keep the engine from writing MUJOCO_LOG.TXT and messages; warnings are counted anyway."""
    config = mujoco.MjLogConfig.get() if hasattr(mujoco, "MjLogConfig") else None
    if config is not None:
        config.logto_file = config.logto_console = False
        config.set()


def roll_out(
    models: Sequence[mujoco.MjModel],
    qpos: Floats,
    qvel: Floats,
    steps: int,
    buffers: Buffers,
    watch: Callable[[], None] = lambda: None,
) -> Rollout:
    """Step every run by itself on this thread, so that its CPU time is its own.

    Bit for bit equal to a loop over `mj_step` for each run.

    Args:
        models: (n) compiled models of one layout; automatic reset must be off.
        qpos: (n, nq) start configurations.
        qvel: (n, nv) start velocities.
        steps: N.
        buffers: memory to record into; its arrays are overwritten by the next call.
        watch: called before each run, to start its time limit.
    """
    count = len(models)
    sleeps = any(model.opt.enableflags & _PERSISTENT for model in models)
    batch = Batch(models[0], count, 1, persistent=bool(sleeps))
    batch.set_models(list(models))
    if sleeps:
        batch.reset()
    batch.bind("qpos")[:] = qpos
    batch.bind("qvel")[:] = qvel
    arrays = buffers.arrays(models[0], count, steps)
    arrays.state[:, 0] = 0.0
    arrays.state[:, 0, 1 : 1 + qpos.shape[1]] = qpos
    arrays.state[:, 0, 1 + qpos.shape[1] : 1 + qpos.shape[1] + qvel.shape[1]] = qvel
    cost = np.zeros(count)
    errors: list[str | None] = [None] * count
    for run in range(count):
        out: dict[Any, np.ndarray] = {
            int(STATE): arrays.state[run : run + 1, 1:],
            "sensordata": arrays.sensors[run : run + 1],
            "solver_niter": arrays.iterations[run : run + 1],
        }
        watch()
        start = time.thread_time()
        try:
            batch.rollout(steps, record=list(out), ids=[run], out=out)
        except SimulationError as error:
            errors[run] = str(error)
        cost[run] = time.thread_time() - start
    return Rollout(
        state=arrays.state,
        sensors=arrays.sensors,
        iterations=arrays.iterations,
        steps=tuple(
            0 if errors[run] else _valid_steps(arrays.state[run, :, 0]) for run in range(count)
        ),
        cost=cost,
        warnings=tuple(_warnings(batch.warning[run]) for run in range(count)),
        errors=tuple(errors),
    )


def _valid_steps(clock: Floats) -> int:
    """Return how many steps the clock grew; a stopped run repeats its last record."""
    stuck = np.flatnonzero(np.diff(clock) <= 0)
    return int(stuck[0]) if len(stuck) else len(clock) - 1


def _warnings(counts: np.ndarray) -> dict[str, int]:
    return {
        mujoco.mjtWarning(kind).name.removeprefix("mjWARN_").lower(): int(counts[kind])
        for kind in np.flatnonzero(counts)
    }
