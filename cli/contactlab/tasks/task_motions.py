"""The motions of a task's phases: the runs of every study, cut where phases begin."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.budget import Motion
from contactlab.budget.windows import usual_changes
from contactlab.contact.trace_arrays import Floats
from contactlab.engines import Buffers, PreparedRuns, engine_of
from contactlab.engines.closed_loop import allowed_policy, load_policy
from contactlab.engines.mujoco_batch import driven_inputs, start_batch
from contactlab.engines.older_mujoco import SimulationError
from contactlab.errors import EngineError, SceneError
from contactlab.modifications.model_predicates import read_gravity
from contactlab.scene.scene import Scene
from contactlab.schema.task import Phase, Task
from contactlab.tasks.session import Values

_ENGINE = "mujoco"
_CONTROL = int(mujoco.mjtState.mjSTATE_CTRL)


class _Piece(NamedTuple):
    """A phase of one seed: its start, the inputs of its steps, and the kind of the inputs."""

    start: Floats
    inputs: Floats
    spec: int


Change = Callable[[mujoco.MjModel], mujoco.MjModel]
"""Returns the model that moves in place of the scene's."""


def as_it_is(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return a model unchanged."""
    return model


def with_new_seeds(task: Task) -> Task:
    """Return the task with unused seeds."""
    count = max(task.seeds) + 1
    return task.model_copy(update={"seeds": tuple(seed + count for seed in task.seeds)})


def shorten_task(task: Task, share: float) -> Task:
    """Return the task with the first share of each of its phases, which begin as before."""
    phases = tuple(
        phase.model_copy(update={"end": phase.begin + share * (phase.end - phase.begin)})
        for phase in task.phases
    )
    return task.model_copy(update={"phases": phases})


def task_motions(
    scene: Scene,
    values: Values,
    task: Task,
    *,
    allow_code: bool = False,
    change: Change = as_it_is,
) -> list[Motion]:
    """Return one motion for each phase of a task, with a row for each of its seeds.

    A seed has no part in a phase if the engine gave up its run before. A phase without seeds is
    left out; the phase before says why. Without weight, each phase knows the usual accelerations of
    the others. `change` returns the model that moves in place of the scene's. The actions
    of a policy are replayed; a policy is code, which has to be allowed.

    Raises:
        EngineError: another engine than MuJoCo is requested.
        SceneError: a policy is not allowed, or fails.
    """
    runs = scene.resolve_seeds(values, task.seeds, task.duration)
    if (engine := runs[0].engine) != _ENGINE:
        raise EngineError(f"examine measures MuJoCo's own motion, not that of engine {engine}")
    prepared = PreparedRuns.of(scene, *runs, is_drawn=False)
    model = change(prepared.models[0])
    prepared = replace(prepared, prepared=[replace(run, model=model) for run in prepared.prepared])
    if policy := allowed_policy(scene.drive, allowed=allow_code):
        # The actions of the policy become recorded controls.
        prepared = replace(prepared, policy=load_policy(policy))
        rollout = engine_of(prepared.resolved[0]).roll_out(prepared, Buffers())
        if failed := next((error for error in rollout.errors if error), None):
            raise SceneError(f"the controller ended the run: {failed}")
        prepared = prepared.with_recorded_controls(rollout.controls)
    spans = [span for phase in task.phases if (span := _find_span(phase, model, prepared.steps))]
    pieces = [list(_reached_pieces(prepared, run, spans)) for run in range(len(runs))]
    motions = list[Motion]()
    for place, phase in enumerate(task.phases[: len(spans)]):
        reached = [parts[place] for parts in pieces if place < len(parts)]
        if reached:
            starts = np.concatenate([piece.start for piece in reached])
            inputs = np.concatenate([piece.inputs for piece in reached])
            spec, observed = reached[0].spec, tuple(task.observed)
            motions.append(Motion(model, starts, inputs, spec, phase.name, observed))
    if read_gravity(model) or len(motions) == 1:
        return motions
    usual = usual_changes(motions)
    return [replace(motion, usual=usual) for motion in motions]


def _find_span(phase: Phase, model: mujoco.MjModel, steps: int) -> tuple[int, int] | None:
    """Return the first step of a phase and the one after its last; None if it has none."""
    begin, end = (round(time / model.opt.timestep) for time in (phase.begin, phase.end))
    return (begin, min(max(end, begin + 1), steps)) if begin < steps else None


def _reached_pieces(
    prepared: PreparedRuns, run: int, spans: Sequence[tuple[int, int]]
) -> Iterator[_Piece]:
    """Yield the phases that a run reaches."""
    model, start = prepared.models[run], prepared.starts.select_run(run)
    batch = start_batch([model], start)
    reached_step = 0
    for begin, end in spans:
        try:
            if begin > reached_step:
                batch.rollout(
                    begin - reached_step,
                    record=[],
                    **driven_inputs(model, start, 0, begin - reached_step, reached_step),
                )
        except SimulationError:
            return
        if batch.warning.any():
            return
        reached_step = begin
        inputs_of_piece = driven_inputs(model, start, 0, end - begin, begin)
        inputs = inputs_of_piece.get("control", np.empty((1, end - begin, 0)))
        yield _Piece(batch.state.copy(), inputs, int(inputs_of_piece.get("control_spec", _CONTROL)))
