"""MuJoCo as an engine: in native batches since 3.17, stepped from Python before."""

import time
from dataclasses import replace

import mujoco
import numpy as np

from contactlab.engines.closed_loop import fly
from contactlab.engines.contact_kernel import roll_out_by_kernel
from contactlab.engines.engine import (
    Buffers,
    PreparedRuns,
    Proceed,
    Rollout,
    SimulationEngine,
    Watch,
    bytes_of_run,
    engine,
    no_limit,
    package_version,
    proceed_always,
)
from contactlab.engines.sampled_loads import with_loads
from contactlab.engines.self_checks import run_checks
from contactlab.engines.single_run import count_work, integrate_to, time_segments, time_steps
from contactlab.errors import SceneError
from contactlab.mjcf import MODEL_ENGINE
from contactlab.scene.compiled_scene import CompiledScene
from contactlab.scene.model_edits import LOOP_ENGINE
from contactlab.scene.mujoco_versions import has_batch
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene
from contactlab.schema.drive import PolicyDrive

# Read before workers are forked.
_VERSION = package_version("mujoco")


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
        return _VERSION

    def roll_out(
        self,
        runs: PreparedRuns,
        buffers: Buffers,
        watch: Watch = no_limit,
        proceed: Proceed = proceed_always,
    ) -> Rollout:
        """Simulate runs one after the other, or under policies together, which share their cost."""
        roll_out = roll_out_by_kernel if runs.policy is None else fly
        rollout = with_loads(runs, roll_out(runs, buffers, watch, proceed))
        return self._with_cost(runs, rollout)

    def _with_cost(self, runs: PreparedRuns, rollout: Rollout) -> Rollout:  # noqa: ARG002
        return rollout

    def least_bytes(self, base: CompiledScene, run: RunSpec) -> int:
        """Return the memory [bytes] of a run without contacts, if no policy acts in it.

        How many contacts there are is seen as runs are made, and no more are than memory holds.
        """
        if isinstance(run.drive, PolicyDrive):
            return super().least_bytes(base, run)
        measured = base.model.nsensordata - base.layout.contacts
        return bytes_of_run(base.model, run.steps, measured)

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


engine(MujocoEngine if has_batch() else OlderMujocoEngine)


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


_NOT_HERE = "a loop that is not in the store made the run, so it is not simulated again; render it"


@engine
class LoopEngine(SimulationEngine):
    """Simulates nothing: what loops and environments do is read from MuJoCo's data meanwhile."""

    name = LOOP_ENGINE
    summary = "a loop, or an environment"
    runs_policies = True
    own_laws = False

    @property
    def version(self) -> str:
        """The version of MuJoCo, which loops step."""
        return _VERSION

    def refusal(self, scene: Scene, run: RunSpec) -> str | None:
        """Return why it runs nothing, or why an environment cannot."""
        environment = scene.source.environment
        return environment.refusal(run) if environment else _NOT_HERE

    def seconds_per_step(self, runs: PreparedRuns) -> float:
        """Return what MuJoCo alone takes for a step [s]."""
        return runs.scene.source.environment.seconds_per_step(runs)

    def roll_out(self, *_: object, **__: object) -> Rollout:
        """Raise a SceneError."""
        raise SceneError(_NOT_HERE)
