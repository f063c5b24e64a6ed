"""Every run of a plan, by its id alone, so that a plan of any size fits into memory."""

import hashlib
import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import cached_property

import numpy as np

from contactlab.engines import bytes_of_run
from contactlab.errors import SceneError, SweepFileError
from contactlab.plan import Plan
from contactlab.run.tasks import Job, PlannedRun
from contactlab.scene import ID_BYTES, CompiledScene, ResolvedRow, ResolvedRun, RowGroup, Scene

_ID = np.dtype(">u8")
_DIGITS = 2 * ID_BYTES
# Start states that are remembered as checked.
_MAX_CHECKED = 1 << 12


class RunIndex:
    """The distinct runs of a plan, in its order; of runs that are equal, the first counts.

    Attributes:
        firsts: for each shape of rows, in order of appearance, the values of its first row.
    """

    def __init__(self, plan: Plan, scene: Scene) -> None:
        """Find every run's id, a few microseconds each.

        Raises:
            SceneError: the model's own timestep is none, and the sweep sets no other; or a run's
                control or hold has times that make no sense.
        """
        self._plan = plan
        self._rows = scene.rows(plan.sweep.duration)
        self.firsts: dict[RowGroup, Mapping[str, object]] = {}
        found = bytearray()
        check = _Check(scene)
        for row in plan.rows():
            resolved = self._rows.row(row.values)
            check(resolved)
            self.firsts.setdefault(resolved.shape, row.values)
            found += resolved.run_ids(row.seeds)
        self._ids = bytes(found)
        self._kept = np.zeros(len(self._ids) // ID_BYTES, bool)
        self._kept[np.unique(np.frombuffer(self._ids, _ID), return_index=True)[1]] = True

    def __len__(self) -> int:
        """Return the number of distinct runs."""
        return int(np.count_nonzero(self._kept))

    @cached_property
    def hash(self) -> str:
        """A hash of all ids in order."""
        return hashlib.sha256(self._text().encode()).hexdigest()[:32]

    def count(self, done: Collection[str]) -> int:
        """Return how many of the runs are among those that are done."""
        text = self._text() if done else ""
        return sum(text[at : at + _DIGITS] in done for at in range(0, len(text), _DIGITS))

    def runs(self, done: Collection[str] = ()) -> Iterator[tuple[PlannedRun, ResolvedRun]]:
        """Yield every run, but for those that are done, with what it resolves to."""
        kept = self._kept.tobytes()
        for row in self._plan.rows():
            resolved = None
            for index, seed in enumerate(row.seeds, row.first):
                run_id = self._ids[ID_BYTES * index : ID_BYTES * (index + 1)].hex()
                if kept[index] and run_id not in done:
                    resolved = resolved or self._rows.row(row.values)
                    run = PlannedRun(index, run_id, row.values, seed)
                    yield run, resolved.resolved(seed)

    def rows(self) -> Iterator[tuple[ResolvedRow, int]]:
        """Yield what rows resolve to, each with the number of its runs that count."""
        starts = range(0, len(self._kept), len(self._plan.sweep.seed_values))
        counts = np.add.reduceat(self._kept, starts, dtype=np.int64).tolist()
        for row, count in zip(self._plan.rows(), counts, strict=True):
            if count:
                yield self._rows.row(row.values), count

    def _text(self) -> str:
        return np.frombuffer(self._ids, _ID)[self._kept].tobytes().hex()


class _Check:
    """Checks what rows resolve to before anything runs."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._fine: set[object] = set()

    def __call__(self, row: ResolvedRow) -> None:
        if not 0 < row.timestep < math.inf:
            raise SceneError(
                f"{self._scene.source.model}: its timestep is {row.timestep:g} s; write one above "
                "0 there, or sweep `timestep`"
            )
        if not self._scene.initial.is_timed or (start := row.start) in self._fine:
            return
        self._scene.initial.check(row.resolved(0))
        if len(self._fine) < _MAX_CHECKED:
            self._fine.add(start)


MAX_RUNS = 32
# A job's records; with its temporary arrays a worker needs about three times as much.
JOB_BYTES = 32 << 20
RUN_BYTES = 1 << 30
# A worker's models; one with meshes may take tens of MiB.
MODEL_BYTES = 256 << 20
_MAX_OPEN = 64

Key = tuple[object, ...]
Planned = Sequence[tuple[PlannedRun, ResolvedRun]]


def pack_jobs(
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
    most = max(1, min(MAX_RUNS, count // (4 * max(1, workers))))
    shares = 2 * workers if workers > 1 else 1
    waiting: dict[Key, list[PlannedRun]] = {}
    bounds: dict[Key, int] = {}
    for taken, (run, resolved) in enumerate(runs):
        key = _key(resolved)
        bound = bounds.get(key)
        if bound is None:
            bound = bounds[key] = _max_runs(scene, resolved, most)
        group = waiting.setdefault(key, [])
        group.append(run)
        if len(group) >= min(bound, max(1, (count - taken) // shares)):
            yield tuple(waiting.pop(key))
        elif len(waiting) > _MAX_OPEN:
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


def _max_runs(scene: Scene, resolved: ResolvedRun, most: int) -> int:
    base = scene.base_of(resolved)
    size = bytes_of_run(base.model, resolved.steps)
    if size > RUN_BYTES:
        raise SweepFileError(
            f"a run of {resolved.steps:,} steps would record {size / 2**30:.1f} GiB in memory; "
            "the bound is 1 GiB. Shorten `duration` or grade fewer pairs"
        )
    return max(1, min(most, JOB_BYTES // size, max_models(base)))


def max_models(base: CompiledScene) -> int:
    """Return how many models like this one a worker may hold; at least one."""
    return max(1, MODEL_BYTES // base.size)
