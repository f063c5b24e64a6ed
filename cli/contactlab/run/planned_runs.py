"""From a plan to its distinct runs, to jobs, and to the models and initial states of a job."""

import faulthandler
import hashlib
import math
import signal
from collections import OrderedDict
from collections.abc import Collection, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from contactlab.engines import ENGINES, engine_of
from contactlab.engines.engine import Watch, bytes_of_run, no_limit
from contactlab.errors import OutputError, SceneError, StoreError, SweepFileError
from contactlab.mjcf import AT_REST
from contactlab.plan.grid import Plan
from contactlab.run.evidence_record import RunPlan
from contactlab.run.tasks import Job, PlannedRun, Task
from contactlab.scene.compiled_scene import CompiledScene, PreparedModel
from contactlab.scene.drive.located_drive import LocatedDrive
from contactlab.scene.effects.effect_table import is_straight
from contactlab.scene.initial_states import InitialStates
from contactlab.scene.model_edits import LOOP_ENGINE
from contactlab.scene.mujoco_versions import silence_mujoco
from contactlab.scene.resolution import ID_BYTES, ResolvedRun
from contactlab.scene.row_resolution import ResolvedRow, RowGroup, RowResolver
from contactlab.scene.scene import Scene
from contactlab.scene.scene_source import stored_scene
from contactlab.schema.drive import PolicyDrive, parse_drive
from contactlab.schema.evidence import SweepIdentity
from contactlab.schema.sweep_schema import Sweep, effects_base
from contactlab.store.control_tables import read_control_table
from contactlab.store.controls_file import read_controls
from contactlab.store.folder_backend import backend_at
from contactlab.store.store_files import SCENES, Address

# Runs of a job at most: of short ones as many as have so many steps, so that they share more.
MAX_RUNS, _FEW_RUNS, _SHORT_STEPS = 512, 32, 1 << 13
# Steps of a job, times the square of the degrees of freedom: from the second on, what a job takes
# by itself is small; below the first it is more than what an idle worker would save.
LEAST_WORK, SMALL_WORK = 1 << 19, 1 << 22
# Recorded states and sensors of a job; with temporary arrays a worker needs three times as much.
JOB_BYTES = 64 << 20
RUN_BYTES = 1 << 30
# Compiled models of a worker; one with meshes may take tens of MiB.
MODEL_BYTES = 256 << 20
_MAX_OPEN = 64

Key = tuple[object, ...]
Planned = Sequence[tuple[PlannedRun, ResolvedRun]]
_ID = np.dtype(">u8")
_DIGITS = 2 * ID_BYTES
# Initial states that are remembered as checked.
_MAX_CHECKED = 1 << 12
_MOST_STEPS = 1e12


def reference_models(scene: Scene, sweep: Sweep, planned: Planned) -> dict[str, ResolvedRun]:
    """Return what runs are compared with, by run id: themselves, or the scene as written."""
    asked = sweep.accuracy
    if asked is None or asked.against == "own":
        return {run.run_id: each for run, each in planned}
    scenario = [*sweep.scenario, *asked.scenario]
    return {run.run_id: scene.as_written(each, run.values, scenario) for run, each in planned}


class RunIndex:
    """The distinct runs of a plan, in its order; of equal runs, the first counts.

    It has 9 bytes of each run, so that a plan of any size fits into memory.
    """

    def __init__(self, plan: Plan, scene: Scene) -> None:
        """Compute every run's id, a few microseconds each.

        Raises a SceneError if the model's timestep is not positive, and the sweep sets no other; or
        the times of a run's control or hold are inconsistent; a SweepFileError if a run would
        record more than 1 GiB.
        """
        self._plan = plan
        self._rows = RowResolver(scene, plan.sweep.duration)
        # For each shape of rows, in order of appearance, the values of its first row.
        self.firsts: dict[RowGroup, Mapping[str, object]] = {}
        ids = bytearray()
        check = _Check(scene)
        for row in plan.rows():
            resolved = self._rows.row(row.values)
            check(resolved)
            self.firsts.setdefault(resolved.group, row.values)
            ids += resolved.run_ids(row.seeds)
        self._ids = bytes(ids)
        self._distinct = np.zeros(len(self._ids) // ID_BYTES, bool)
        self._distinct[np.unique(np.frombuffer(self._ids, _ID), return_index=True)[1]] = True

    def __len__(self) -> int:
        """Return the number of distinct runs."""
        return int(np.count_nonzero(self._distinct))

    @cached_property
    def hash(self) -> str:
        """A hash of all ids in order."""
        return hashlib.sha256(self._text().encode()).hexdigest()[:32]

    def count(self, done: Collection[str]) -> int:
        """Return how many of the runs are among those that are done."""
        text = self._text() if done else ""
        return sum(text[at : at + _DIGITS] in done for at in range(0, len(text), _DIGITS))

    def has(self, run_id: str, index: int) -> bool:
        """Return whether a run of this id is at this place of the plan."""
        return (
            index < len(self._distinct)
            and bool(self._distinct[index])
            and self._ids[ID_BYTES * index : ID_BYTES * (index + 1)].hex() == run_id
        )

    def runs(self, done: Collection[str] = ()) -> Iterator[tuple[PlannedRun, ResolvedRun]]:
        """Yield every run that is not done, with its settings."""
        distinct = self._distinct.tobytes()
        for row in self._plan.rows():
            resolved = None
            for index, seed in enumerate(row.seeds, row.first):
                run_id = self._ids[ID_BYTES * index : ID_BYTES * (index + 1)].hex()
                if distinct[index] and run_id not in done:
                    resolved = resolved or self._rows.row(row.values).resolved(seed)
                    run = PlannedRun(index, run_id, row.values, seed)
                    yield run, resolved.seeded(seed)

    def rows(self) -> Iterator[tuple[ResolvedRow, int]]:
        """Yield the settings of rows, each with the number of its distinct runs."""
        starts = range(0, len(self._distinct), len(self._plan.sweep.seed_values))
        counts = np.add.reduceat(self._distinct, starts, dtype=np.int64).tolist()
        for row, count in zip(self._plan.rows(), counts, strict=True):
            if count:
                yield self._rows.row(row.values), count

    def _text(self) -> str:
        return np.frombuffer(self._ids, _ID)[self._distinct].tobytes().hex()


class _Check:
    """Checks the settings of rows before anything runs."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._checked: set[object] = set()
        self._least: dict[RowGroup, float] = {}

    def __call__(self, row: ResolvedRow) -> None:
        if not row.timestep >= self._least.get(row.group, math.inf):
            self._check_steps(row)
            self._least[row.group] = row.timestep
        engine = engine_of(row.group.first)
        if isinstance(row.group.first.drive, PolicyDrive) and not engine.runs_policies:
            raise SceneError(
                f"the {engine.name} engine runs no policies; sweep with engine: mujoco, then drive "
                "this engine by a file of the store's controls"
            )
        if not engine.accepts_every_run and (why := engine.refusal(self._scene, row.resolved(0))):
            raise SceneError(why)
        if row.group.first.changed & AT_REST.keys():
            run = row.resolved(0)
            self._scene.base_of(run).prepare(run.edits())
        driven = row.group.first.drive not in ("none", "hold")
        key = (*row.start, row.timestep) if driven else row.start
        if (driven or self._scene.is_timed) and key not in self._checked:
            self._scene.check_start(row.resolved(0))
            if len(self._checked) < _MAX_CHECKED:
                self._checked.add(key)

    def _check_steps(self, row: ResolvedRow) -> None:
        """Check that a run has steps, and that memory holds what it records."""
        if not 0 < row.timestep < math.inf:
            raise SceneError(
                f"{self._scene.source.model}: its timestep is {row.timestep:g} s; write a "
                "positive one there, or sweep `timestep`"
            )
        duration = row.group.first.duration
        if duration / row.timestep > _MOST_STEPS:
            raise SweepFileError(
                f"{duration:g} s in steps of {row.timestep:g} s are too many; lengthen `timestep`"
            )
        run = row.resolved(0)
        size = bytes_of_run(self._scene.base_of(run).model, run.steps)
        if size > RUN_BYTES:
            raise SweepFileError(
                f"a run of {run.steps:,} steps would record {size / 2**30:.1f} GiB in memory; "
                "the limit is 1 GiB. Shorten `duration` or monitor fewer pairs"
            )


def pack_jobs(
    runs: Iterable[tuple[PlannedRun, ResolvedRun]], count: int, scene: Scene, workers: int
) -> Iterator[Job]:
    """Yield jobs, each bounded by `MAX_RUNS`, `JOB_BYTES` and `MODEL_BYTES`, or one run.

    Runs, those that are not done yet, are consumed lazily, some hundred ahead of what is yielded.
    Each worker gets several jobs, which become smaller towards the end, so that none has a large
    one while the others have none.
    """
    most, fair = count // (4 * max(1, workers)), -(-count // max(1, workers))
    shares = 2 * workers if workers > 1 else 1
    waiting: dict[Key, list[PlannedRun]] = {}
    bounds: dict[Key, tuple[int, int]] = {}
    key, settings = Key(), None
    for taken, (run, resolved) in enumerate(runs):
        if resolved.settings is not settings:  # Runs that differ only in their seed share them.
            sleep, settings = resolved.flags.get("sleep"), resolved.settings
            structure = resolved.structure.items()
            key = (*structure, resolved.steps, resolved.engine, sleep, resolved.without)
        if key not in bounds:
            base, steps = scene.base_of(resolved), resolved.steps
            size, work = bytes_of_run(base.model, steps), steps * max(1, base.model.nv) ** 2
            short = _SHORT_STEPS // steps
            least = max(LEAST_WORK, min(SMALL_WORK, fair * work)) // work
            if isinstance(resolved.drive, PolicyDrive) or resolved.engine == LOOP_ENGINE:
                short = least = 0
            bound = min(MAX_RUNS, max(_FEW_RUNS, short), JOB_BYTES // size, _max_models(base))
            least = max(1, min(bound, least))
            bounds[key] = least, max(least, min(bound, most))
        group = waiting.setdefault(key, [])
        group.append(run)
        least, bound = bounds[key]
        if len(group) >= min(bound, max(least, (count - taken) // shares)):
            yield tuple(waiting.pop(key))
        elif len(waiting) > _MAX_OPEN:
            yield tuple(waiting.pop(next(iter(waiting))))
    yield from (tuple(group) for group in waiting.values())


def _max_models(base: CompiledScene) -> int:
    """Return how many models like this one a worker may hold; at least one."""
    return max(1, MODEL_BYTES // base.size)


def stored_sweep_scene(identity: SweepIdentity, folder: Path) -> Scene:
    """Return the scene of a store's sweep, with its drive, from the store's own files.

    The folder is the store's copy of the scene. Raises a SceneError if it does not compile with
    this engine, or a file is not what it was.
    """
    source = stored_scene(folder, identity.scene_model, identity.scene)
    scene = Scene(source, ENGINES, read_control_table)
    scene = scene.with_effects(effects_base(identity.resolved.get("effects", {})))
    if (stored := identity.resolved.get("drive")) is None:
        return scene
    drive = parse_drive(stored)
    return scene.with_drive(drive, folder.parent / (LocatedDrive(drive).hash or ""))


def local_scene(store: Address, folder: Path) -> Path:
    """Return a local folder with a store's scene, fetched from object storage if need be.

    The given one is on the machine that runs the sweep; its name is the scene's hash.
    """
    if folder.is_dir():
        return folder
    return backend_at(store, OutputError).local_folder(SCENES) / folder.name


_MAX_MODELS = 64


class Preparer:
    """Prepares the runs of one sweep; its scene is the store's copy."""

    def __init__(self, task: Task, marker: Path | None) -> None:
        silence_mujoco()
        self.task = task
        folder = local_scene(task.store, task.scene_folder)
        self.scene = stored_sweep_scene(task.identity, folder)
        if self.scene.hash != task.scene_folder.name:
            raise StoreError(f"{folder} was changed: its files have the hash {self.scene.hash}")
        self._marker = marker
        self._rows = RowResolver(self.scene, task.sweep.duration)
        self._models: OrderedDict[tuple[str, bool], PreparedModel] = OrderedDict()

    def plans(self, job: Job) -> list[RunPlan]:
        """Return settings, model and initial state of each run of a job of one structure."""
        rows = {id(run.values): run for run in job}
        first = {key: self._rows.row(run.values).resolved(0) for key, run in rows.items()}
        resolved = [first[id(run.values)].seeded(run.seed) for run in job]
        starts = self.scene.starts(resolved)
        initial = [self._acted_on(run, starts.pick(place)) for place, run in enumerate(job)]
        keys: dict[int, str] = {}  # of the models of runs that share their values
        plans: list[RunPlan] = []
        for run, each, start in zip(job, resolved, initial, strict=True):
            key = keys.get(id(run.values)) or self.scene.model_key(each)
            keys[id(run.values)] = key
            plans.append(RunPlan(each, self._prepared(key, each, start), start, run))
        return plans

    def _acted_on(self, run: PlannedRun, start: InitialStates) -> InitialStates:
        """Return how a run starts, with what its policy did where that is recorded."""
        if run.controls is None:
            return start
        backend = backend_at(self.task.store, OutputError)
        return start.acted_on([read_controls(backend, run.controls)])

    def _prepared(self, shared: str, run: ResolvedRun, start: InitialStates) -> PreparedModel:
        base = self.scene.base_of(run)
        key = shared, is_straight(base.model, start)
        if key not in self._models:
            self._models[key] = self.scene.prepare(run, start)
            most = min(_MAX_MODELS, _max_models(base))
            while len(self._models) > most:
                self._models.popitem(last=False)
        self._models.move_to_end(key)
        return self._models[key]

    @contextmanager
    def watchdog(self, times: float = 1) -> Generator[Watch]:
        """Yield what starts the time limit of a run, which ends this process when it is exceeded.

        It is so many times that of the sweep, and holds even where a run never returns to
        Python: the process dies of SIGALRM, and its traceback is in the marker, else empty.
        """
        if self._marker is None:
            yield no_limit
            return
        with self._marker.open("w") as file:
            # A timer takes one system call; faulthandler's own starts a thread each time.
            faulthandler.register(signal.SIGALRM, file=file, all_threads=False, chain=True)
            try:
                yield partial(_start_clock, times * self.task.sweep.timeout)
            finally:
                signal.setitimer(signal.ITIMER_REAL, 0)
                faulthandler.unregister(signal.SIGALRM)


def _start_clock(seconds: float) -> None:
    signal.setitimer(signal.ITIMER_REAL, seconds)
