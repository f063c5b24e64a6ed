"""MuJoCo as an engine: in native batches since 3.17, stepped from Python before that."""

import time
from dataclasses import replace

import mujoco
import numpy as np

from contactlab.engines.closed_loop import roll_out_policy
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
_MUJOCO_VERSION = package_version("mujoco")


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
        return _MUJOCO_VERSION

    def roll_out(
        self,
        runs: PreparedRuns,
        buffers: Buffers,
        watch: Watch = no_limit,
        proceed: Proceed = proceed_always,
    ) -> Rollout:
        """Simulate runs one after the other; under policies together, with shared cost."""
        roll_out = roll_out_by_kernel if runs.policy is None else roll_out_policy
        rollout = with_loads(runs, roll_out(runs, buffers, watch, proceed))
        return self._with_cost(runs, rollout)

    def _with_cost(self, runs: PreparedRuns, rollout: Rollout) -> Rollout:  # noqa: ARG002
        return rollout

    def least_bytes(self, base: CompiledScene, run: RunSpec) -> int:
        """Return the memory [bytes] of a run without contacts, if no policy acts in it.

        The number of contacts is known only during the runs, and runs stop when memory is full.
        """
        if isinstance(run.drive, PolicyDrive):
            return super().least_bytes(base, run)
        sensor_numbers = base.model.nsensordata - base.layout.contacts
        return bytes_of_run(base.model, run.steps, sensor_numbers)

    def seconds_per_step(self, runs: PreparedRuns) -> float:
        """Return the time of a step [s], without the overhead of a batch."""
        return float(self.roll_out(runs, Buffers()).cost.mean()) / runs.steps

    check_runs = staticmethod(run_checks)
    integrate_to = staticmethod(integrate_to)
    count_work = staticmethod(count_work)
    time_segments = staticmethod(time_segments)
    time_steps = staticmethod(time_steps)


class OlderMujocoEngine(MujocoEngine):
    """MuJoCo before 3.17: the same bits, more slowly, with costs from a second simulation."""

    def _with_cost(self, runs: PreparedRuns, rollout: Rollout) -> Rollout:
        """Return a rollout with the cost of the same steps without Python between them."""
        cost = [_native_cost(runs, run, step_count) for run, step_count in enumerate(rollout.steps)]
        return replace(rollout, cost=np.array(cost))

    def seconds_per_step(self, runs: PreparedRuns) -> float:
        """Return the time of a step [s], including its Python overhead."""
        return SimulationEngine.seconds_per_step(self, runs)

    def null_fields(self, *, driven: bool) -> dict[str, str]:
        """Return why driven runs have no cost."""
        if not driven:
            return {}
        return {
            "cost": f"MuJoCo {mujoco.__version__} gets changing inputs from Python, and its time "
            "would count; 3.17.0 gets them all at once"
        }


engine(MujocoEngine if has_batch() else OlderMujocoEngine)


def _native_cost(runs: PreparedRuns, run: int, steps: int) -> float:
    """Return the time of a run's steps without Python between them, from a repetition [s]."""
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


_MISSING_LOOP = "a loop that is not in the store made the run, so it cannot be repeated; render it"


@engine
class LoopEngine(SimulationEngine):
    """Simulates nothing: MuJoCo's data are read while a loop or an environment runs."""

    name = LOOP_ENGINE
    summary = "a loop, or an environment"
    runs_policies = True
    own_laws = False

    @property
    def version(self) -> str:
        """The version of MuJoCo, which loops step."""
        return _MUJOCO_VERSION

    def refusal(self, scene: Scene, run: RunSpec) -> str | None:
        """Return why it runs nothing, or why an environment cannot run."""
        environment = scene.source.environment
        return environment.refusal(run) if environment else _MISSING_LOOP

    def seconds_per_step(self, runs: PreparedRuns) -> float:
        """Return the time of a step of MuJoCo alone [s]."""
        return runs.scene.source.environment.seconds_per_step(runs)

    def roll_out(self, *_: object, **__: object) -> Rollout:
        """Raise a SceneError."""
        raise SceneError(_MISSING_LOOP)
