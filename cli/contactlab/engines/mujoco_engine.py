"""MuJoCo as an engine: in native batches since 3.17, stepped from Python before."""

import copy
import time
from dataclasses import replace

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.engines.closed_loop import fly
from contactlab.engines.engine import (
    Buffers,
    PreparedRuns,
    Proceed,
    Rollout,
    SimulationEngine,
    Watch,
    no_limit,
    package_version,
    proceed_always,
)
from contactlab.engines.mujoco_batch import STATE, roll_out
from contactlab.engines.self_checks import run_checks
from contactlab.engines.single_run import count_work, integrate_to, time_segments, time_steps
from contactlab.scene.initial_states import InitialStates, apply_inputs
from contactlab.scene.model_edits import MODEL_ENGINE

_STEPS_OF_SAMPLE = 250
"""Steps for each sample, which takes as long as three or four of them."""
_FEWEST_SAMPLES, _MOST_SAMPLES = 2, 16
_EQUALITY = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
_SLEEP = int(getattr(mujoco.mjtEnableBit, "mjENBL_SLEEP", 0))


class MujocoEngine(SimulationEngine):
    """MuJoCo with native batches; it can repeat, refine and time its runs."""

    name = MODEL_ENGINE
    summary = "MuJoCo"
    omits_unused_effects = True
    accepts_every_run = True
    runs_policies = True

    @property
    def version(self) -> str:
        """The version of MuJoCo."""
        return package_version("mujoco")

    def roll_out(
        self,
        runs: PreparedRuns,
        buffers: Buffers,
        watch: Watch = no_limit,
        proceed: Proceed = proceed_always,
    ) -> Rollout:
        """Simulate runs one after the other on this thread, so that the cost of each is its own.

        Runs with a policy advance together, and share theirs.
        """
        if runs.policy is not None:
            rollout = fly(runs, buffers, watch, proceed)
        else:
            rollout = roll_out(runs.models, runs.starts, runs.steps, buffers, watch, proceed)
        return self._with_cost(runs, with_loads(runs, rollout))

    def _with_cost(self, runs: PreparedRuns, rollout: Rollout) -> Rollout:  # noqa: ARG002
        return rollout

    def seconds_per_step(self, runs: PreparedRuns) -> float:
        """Return how long a step takes [s], without what a batch takes around its steps."""
        return float(self.roll_out(runs, Buffers()).cost.mean()) / runs.steps

    check_runs = staticmethod(run_checks)
    integrate_to = staticmethod(integrate_to)
    count_work = staticmethod(count_work)
    time_segments = staticmethod(time_segments)
    time_steps = staticmethod(time_steps)


class OlderMujocoEngine(MujocoEngine):
    """MuJoCo before 3.17: the same bits, more slowly, and costs from stepping a second time."""

    def _with_cost(self, runs: PreparedRuns, rollout: Rollout) -> Rollout:
        """Return a rollout with the cost of the same steps without Python between them."""
        cost = [_native_cost(runs, run, made) for run, made in enumerate(rollout.steps)]
        return replace(rollout, cost=np.array(cost))

    def seconds_per_step(self, runs: PreparedRuns) -> float:
        """Return how long a step takes [s], with what Python takes for it."""
        return SimulationEngine.seconds_per_step(self, runs)

    def null_fields(self, *, driven: bool) -> dict[str, str]:
        """Return why driven runs have no cost."""
        if not driven:
            return {}
        return {
            "cost": f"MuJoCo {mujoco.__version__} takes inputs that change from Python, whose time "
            "would count; 3.17.0 takes them all at once"
        }


def _native_cost(runs: PreparedRuns, run: int, steps: int) -> float:
    """Return what a run's steps take without Python between them: made again, unrecorded [s]."""
    model, starts = runs.prepared[run].model, runs.starts
    if starts.signals[run].places.size or runs.policy is not None:
        return np.nan
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = starts.qpos[run], starts.qvel[run], starts.ctrl[run]
    data.xfrc_applied[:], data.act[:] = starts.applied[run].reshape(-1, 6), starts.act[run]
    begin = time.thread_time()
    if steps:
        mujoco.mj_step(model, data, nstep=steps)
    return time.thread_time() - begin


def with_loads(runs: PreparedRuns, rollout: Rollout) -> Rollout:
    """Return a rollout with ranges of its controls, loads and gaps of its equalities, sleepers."""
    first = runs.prepared[0].model
    data = mujoco.MjData(first) if first.neq else None
    ranges = np.zeros((len(rollout.steps), first.nu, 2))
    loads = np.zeros((len(rollout.steps), first.neq))
    gaps, sleeper = np.zeros((*loads.shape, 2)), np.full((len(loads), 3), np.nan)
    for run, steps in enumerate(rollout.steps):
        model = runs.prepared[run].model
        controls = rollout.controls[run] if rollout.controls else None
        if controls is None:
            end = max(steps - 1, 0) * model.opt.timestep
            ranges[run] = runs.starts.control_ranges(run, end)
        else:
            ranges[run] = np.stack([controls.levels.min(axis=0), controls.levels.max(axis=0)], 1)
        if data is None and not model.opt.enableflags & _SLEEP:
            continue
        start = runs.starts.pick(run)
        start = start if controls is None else start.acted_on([controls])
        if model.opt.enableflags & _SLEEP:
            sleeper[run] = _sleeper(model, start, rollout.state[run, : steps + 1])
        if data is not None and steps:
            loads[run], gaps[run] = _loads(model, data, start, rollout.state[run, : steps + 1])
    rollout = replace(rollout, control_ranges=ranges, sleeper=sleeper)
    return replace(rollout, equality_loads=loads, equality_gaps=gaps)


def _sleeper(model: mujoco.MjModel, start: InitialStates, states: Floats) -> Floats:
    """Return (3,) the worst sleeper of a run, as `Trace` says: what sleeps does not move at all."""
    moving = states[:, 1 + model.nq : 1 + model.nq + model.nv] != 0
    stirring = np.isin(model.dof_treeid, model.dof_treeid[moving[-1]])
    if stirring.all():
        return np.full(3, np.nan)
    awake, last = copy.copy(model), len(states) - 1
    awake.opt.enableflags &= ~_SLEEP
    data = mujoco.MjData(awake)
    mujoco.mj_setState(awake, data, states[last], int(STATE))
    apply_inputs(awake, data, start.inputs(0, model.opt.timestep, np.array([last]))[0])
    mujoco.mj_forward(awake, data)
    acceleration = np.where(stirring, -1, np.abs(data.qacc) * model.dof_length)
    worst = int(acceleration.argmax())
    tree = model.dof_treeid == model.dof_treeid[worst]
    since = moving[:, tree].any(axis=1).cumsum().argmax()
    return np.array([acceleration[worst], model.dof_jntid[worst], since])


def sampled_steps(steps: int) -> np.ndarray:
    """Return the steps of a run before which loads are taken: in the middle of equal parts."""
    samples = max(_FEWEST_SAMPLES, min(_MOST_SAMPLES, steps // _STEPS_OF_SAMPLE))
    return ((np.arange(samples) + 0.5) / samples * steps).astype(np.intp)


def _loads(
    model: mujoco.MjModel, data: mujoco.MjData, start: InitialStates, states: Floats
) -> tuple[Floats, Floats]:
    """Return what equality constraints bore at sampled steps, and how far they were violated.

    (neq,) the largest force of each [N or N m], and (neq, 2) its violation [m or rad]: the largest,
    and the median in the last quarter.
    """
    steps = sampled_steps(len(states) - 1)
    acting = start.inputs(0, model.opt.timestep, steps)
    loads, gaps = np.zeros(model.neq), np.zeros((len(steps), model.neq))
    mujoco.mj_resetData(model, data)
    for sample, (step, inputs) in enumerate(zip(steps, acting, strict=True)):
        mujoco.mj_setState(model, data, states[step], int(STATE))
        apply_inputs(model, data, inputs)
        mujoco.mj_forward(model, data)
        rows = data.efc_type == _EQUALITY
        which = data.efc_id[rows]
        np.maximum.at(loads, which, np.abs(data.efc_force[rows]))
        np.add.at(gaps[sample], which, data.efc_pos[rows] ** 2)
    gaps = np.sqrt(gaps)
    late = gaps[steps >= min(0.75 * (len(states) - 1), steps[-1])]
    return loads, np.stack([gaps.max(axis=0), np.median(late, axis=0)], axis=1)
