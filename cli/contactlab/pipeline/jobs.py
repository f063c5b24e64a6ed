"""From a plan to jobs: runs of one structure and step count, as many as memory allows."""

import math
from collections.abc import Iterable, Iterator, Sequence

from contactlab.errors import SceneError, SweepFileError
from contactlab.pipeline.job import Job, PlannedRun
from contactlab.plan import Plan
from contactlab.scene import Base, Resolved, Scene
from contactlab.sim import bytes_of_run

MOST_RUNS = 32
# A job's records; with its temporary arrays a worker needs about three times as much.
JOB_BYTES = 32 << 20
RUN_BYTES = 1 << 30
# A worker's models; one with meshes may take tens of MiB.
MODEL_BYTES = 256 << 20
_MOST_OPEN = 64

Key = tuple[object, ...]
Planned = Sequence[tuple[PlannedRun, Resolved]]


def planned_runs(plan: Plan, scene: Scene) -> Iterator[tuple[PlannedRun, Resolved]]:
    """Yield every distinct run of a plan with what it resolves to, in plan order.

    Raises:
        SceneError: the model's own timestep is none, and the sweep sets no other; or a run's
            control or hold has times that make no sense.
    """
    seen: set[str] = set()
    for run in plan.runs():
        resolved = scene.resolve(run.values, run.seed, plan.sweep.duration)
        _check_timestep(scene, resolved.timestep)
        scene.check(resolved)
        run_id = scene.run_id(resolved)
        if run_id not in seen:
            seen.add(run_id)
            yield PlannedRun(run.index, run_id, run.values, run.seed), resolved


def _check_timestep(scene: Scene, timestep: float) -> None:
    if not 0 < timestep < math.inf:
        raise SceneError(
            f"{scene.source.model}: its timestep is {timestep:g} s; write one above 0 there, "
            "or sweep `timestep`"
        )


def pack(runs: Iterable[tuple[PlannedRun, Resolved]], scene: Scene, workers: int) -> Iterator[Job]:
    """Yield jobs, each bounded by `MOST_RUNS`, `JOB_BYTES` and `MODEL_BYTES`, or one run.

    Args:
        runs: what is left to do.
        scene: theirs.
        workers: jobs stay small enough that each worker gets several.

    Raises:
        SweepFileError: a run would record more than 1 GiB.
    """
    todo = list(runs)
    most = max(1, min(MOST_RUNS, len(todo) // (4 * max(1, workers))))
    waiting: dict[Key, list[PlannedRun]] = {}
    for run, resolved in todo:
        key = _key(resolved)
        group = waiting.setdefault(key, [])
        group.append(run)
        if len(group) >= _most_of(scene, resolved, most):
            yield tuple(waiting.pop(key))
        elif len(waiting) > _MOST_OPEN:
            yield tuple(waiting.pop(next(iter(waiting))))
    yield from (tuple(group) for group in waiting.values())


def _key(resolved: Resolved) -> Key:
    return (
        *resolved.structure.items(),
        resolved.steps,
        resolved.settings["engine"],
        resolved.flags.get("sleep"),
        resolved.without,
    )


def _most_of(scene: Scene, resolved: Resolved, most: int) -> int:
    base = scene.base_of(resolved)
    size = bytes_of_run(base.model, resolved.steps)
    if size > RUN_BYTES:
        raise SweepFileError(
            f"a run of {resolved.steps:,} steps would record {size / 2**30:.1f} GiB in memory; "
            "the bound is 1 GiB. Shorten `duration` or grade fewer pairs"
        )
    return max(1, min(most, JOB_BYTES // size, most_models(base)))


def most_models(base: Base) -> int:
    """Return how many models like this one a worker may hold; at least one."""
    return max(1, MODEL_BYTES // base.size)
