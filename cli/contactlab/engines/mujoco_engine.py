"""MuJoCo as an engine: in native batches since 3.17, stepped from Python before."""

import time
from dataclasses import replace
from functools import cache
from importlib.metadata import version

import mujoco
import numpy as np

from contactlab.contact import Floats, SelfChecks, Trace
from contactlab.engines.engine import (
    Buffers,
    PreparedRuns,
    Proceed,
    Rollout,
    SampledStates,
    Segments,
    SimulationEngine,
    Watch,
    Work,
    no_limit,
    proceed_always,
)
from contactlab.engines.integration import integrate_to
from contactlab.engines.mujoco_batch import roll_out
from contactlab.engines.self_checks import run_checks
from contactlab.engines.step_timing import count_work, time_segments, time_steps
from contactlab.scene import MODEL_ENGINE, InitialStates

# Reading the metadata of a package takes milliseconds, and every record names the version.
_installed_version = cache(version)


class MujocoEngine(SimulationEngine):
    """MuJoCo with native batches."""

    name = MODEL_ENGINE
    summary = "MuJoCo"
    omits_unused_effects = True
    accepts_every_run = True

    @property
    def version(self) -> str:
        """The version of MuJoCo."""
        return _installed_version("mujoco")

    def roll_out(
        self,
        runs: PreparedRuns,
        buffers: Buffers,
        watch: Watch = no_limit,
        proceed: Proceed = proceed_always,
    ) -> Rollout:
        """Simulate runs one after the other on this thread, so that the cost of each is its own."""
        return roll_out(runs.models, runs.starts, runs.steps, buffers, watch, proceed)

    def seconds_per_step(self, runs: PreparedRuns) -> float:
        """Return how long a step takes [s], without what a batch takes around its steps."""
        return float(self.roll_out(runs, Buffers()).cost.mean()) / runs.steps

    def check_runs(
        self, runs: PreparedRuns, trace: Trace, proceed: Proceed = proceed_always
    ) -> SelfChecks:
        """Return the self-checks of runs that completed."""
        return run_checks(runs, trace, proceed)

    def integrate_to(
        self,
        model: mujoco.MjModel,
        start: InitialStates,
        times: Floats,
        *,
        begin: float = 0.0,
        state: Floats | None = None,
        watch: Watch = no_limit,
    ) -> SampledStates | None:
        """Return a run's states at some times, or None if it does not complete."""
        return integrate_to(model, start, times, begin=begin, state=state, watch=watch)

    def count_work(
        self, model: mujoco.MjModel, start: InitialStates, steps: int, watch: Watch = no_limit
    ) -> Work | None:
        """Simulate one run, untimed, and count; None if it does not complete."""
        return count_work(model, start, steps, watch)

    def time_segments(self, segments: Segments, most: int, repeats: int) -> tuple[float, int]:
        """Return the CPU time of stepping [s], and how many steps it took."""
        return time_segments(segments, most, repeats)

    def time_steps(self, segments: Segments, most: int) -> Floats:
        """Return the CPU time of single steps [s], less what reading the clock takes."""
        return time_steps(segments, most)


class OlderMujocoEngine(MujocoEngine):
    """MuJoCo before 3.17: the same bits, more slowly, and costs from stepping a second time."""

    def roll_out(
        self,
        runs: PreparedRuns,
        buffers: Buffers,
        watch: Watch = no_limit,
        proceed: Proceed = proceed_always,
    ) -> Rollout:
        """Simulate runs; their cost is that of the same steps without Python between them."""
        rollout = super().roll_out(runs, buffers, watch, proceed)
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
    if starts.driven.size:
        return np.nan
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = starts.qpos[run], starts.qvel[run], starts.ctrl[run]
    data.xfrc_applied[:], data.act[:] = starts.applied[run].reshape(-1, 6), starts.act[run]
    begin = time.thread_time()
    if steps:
        mujoco.mj_step(model, data, nstep=steps)
    return time.thread_time() - begin
