"""From a plan to jobs: runs of one structure and step count, as many as memory allows."""

from collections.abc import Iterable, Iterator, Sequence

from contactlab.engines import bytes_of_run
from contactlab.errors import SweepFileError
from contactlab.run.job import Job, PlannedRun
from contactlab.scene import CompiledScene, ResolvedRun, Scene

MOST_RUNS = 32
# A job's records; with its temporary arrays a worker needs about three times as much.
JOB_BYTES = 32 << 20
RUN_BYTES = 1 << 30
# A worker's models; one with meshes may take tens of MiB.
MODEL_BYTES = 256 << 20
_MOST_OPEN = 64

Key = tuple[object, ...]
Planned = Sequence[tuple[PlannedRun, ResolvedRun]]


def pack(
    runs: Iterable[tuple[PlannedRun, ResolvedRun]], count: int, scene: Scene, workers: int
) -> Iterator[Job]:
    """Yield jobs, each bounded by `MOST_RUNS`, `JOB_BYTES` and `MODEL_BYTES`, or one run.

    Runs are taken as they are needed: some hundred more than what is yielded. Towards the end jobs
    become smaller, so that no worker is left with a large one while the others have none.

    Args:
        runs: what is left to do.
        count: how many runs these are.
        scene: theirs.
        workers: jobs stay small enough that each worker gets several.

    Raises:
        SweepFileError: a run would record more than 1 GiB.
    """
    most = max(1, min(MOST_RUNS, count // (4 * max(1, workers))))
    shares = 2 * workers if workers > 1 else 1
    waiting: dict[Key, list[PlannedRun]] = {}
    bounds: dict[Key, int] = {}
    for taken, (run, resolved) in enumerate(runs):
        key = _key(resolved)
        bound = bounds.get(key)
        if bound is None:
            bound = bounds[key] = _most_of(scene, resolved, most)
        group = waiting.setdefault(key, [])
        group.append(run)
        if len(group) >= min(bound, max(1, (count - taken) // shares)):
            yield tuple(waiting.pop(key))
        elif len(waiting) > _MOST_OPEN:
            yield tuple(waiting.pop(next(iter(waiting))))
    yield from (tuple(group) for group in waiting.values())


def _key(resolved: ResolvedRun) -> Key:
    return (
        *resolved.structure.items(),
        resolved.steps,
        resolved.settings["engine"],
        resolved.flags.get("sleep"),
        resolved.without,
    )


def _most_of(scene: Scene, resolved: ResolvedRun, most: int) -> int:
    base = scene.base_of(resolved)
    size = bytes_of_run(base.model, resolved.steps)
    if size > RUN_BYTES:
        raise SweepFileError(
            f"a run of {resolved.steps:,} steps would record {size / 2**30:.1f} GiB in memory; "
            "the bound is 1 GiB. Shorten `duration` or grade fewer pairs"
        )
    return max(1, min(most, JOB_BYTES // size, most_models(base)))


def most_models(base: CompiledScene) -> int:
    """Return how many models like this one a worker may hold; at least one."""
    return max(1, MODEL_BYTES // base.size)
