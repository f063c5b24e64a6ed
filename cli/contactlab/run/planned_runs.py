"""Distinct runs of a plan, their jobs, and the models and initial states of a job."""

import faulthandler
import math
import signal
from collections import OrderedDict
from collections.abc import Collection, Generator, Hashable, Iterable, Iterator
from contextlib import contextmanager
from copy import copy
from functools import cached_property, partial
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from contactlab.accuracy.reference import PlannedModel
from contactlab.disk_arrays import load_disk_memory
from contactlab.engines import ENGINES, engine_of
from contactlab.engines.engine import Watch, bytes_of_run, no_limit
from contactlab.errors import OutputError, SceneError, StoreError, SweepFileError
from contactlab.mjcf import AT_REST, MODEL_ENGINE
from contactlab.plan.grid import Plan, Row
from contactlab.run.tasks import Job, Task
from contactlab.scene.compiled_scene import CompiledScene, PreparedModel, share_detected
from contactlab.scene.drive.located_drive import LocatedDrive
from contactlab.scene.effects.effect_table import is_straight
from contactlab.scene.initial_states import InitialStates
from contactlab.scene.model_edits import LOOP_ENGINE
from contactlab.scene.mujoco_versions import silence_mujoco
from contactlab.scene.run_spec import START_SETTINGS, RunSpec
from contactlab.scene.scene import Scene
from contactlab.scene.scene_source import stored_scene
from contactlab.schema.drive import PolicyDrive, parse_drive
from contactlab.schema.evidence import SweepIdentity
from contactlab.schema.sweep_schema import Sweep, effects_base
from contactlab.store.control_tables import read_control_table
from contactlab.store.controls_file import read_controls
from contactlab.store.finished_store import Store
from contactlab.store.folder_backend import backend_at
from contactlab.store.run_columns import hash_of_ids
from contactlab.store.store_files import SCENES, Address

# Most runs in a job; usual number of runs; short runs are packed up to this number of steps.
MAX_RUNS, _USUAL_RUNS, _SHORT_STEPS = 512, 32, 1 << 13
# Steps of a job, times the square of the degrees of freedom: above the second, the overhead of a
# job is small; below the first it exceeds the time that an idle worker would save.
LEAST_WORK, SMALL_WORK = 1 << 19, 1 << 22
# Bytes of states and sensors of a job; with temporary arrays a worker needs three times as much.
JOB_BYTES = 64 << 20
# Bytes of a run with arrays in temporary files; one with less takes three times as much memory.
LONG_BYTES = 256 << 20
# Bytes of compiled models of a worker; one with meshes may take tens of MiB.
MODEL_BYTES = 256 << 20

Key = tuple[object, ...]
# Runs of a plan that are kept resolved: some kB each if each has different settings.
MAX_KEPT = 1 << 12


def reference_models(scene: Scene, sweep: Sweep, runs: Iterable[RunSpec]) -> dict[str, RunSpec]:
    """Return the runs to compare with, by run id: the runs themselves, or the scene as written."""
    accuracy = sweep.accuracy
    if accuracy is None or accuracy.against == "own":
        return {run.run_id: run for run in runs}
    scenario = [*sweep.scenario, *accuracy.scenario]
    return {run.run_id: scene.resolve_as_written(run, scenario) for run in runs}


class RunIndex:
    """The distinct runs of a plan, in its order; of equal runs, the first counts.

    If they are few, each is resolved once. For a large plan only the first run of each row is
    resolved, and its id is kept: rows that begin with equal runs are equal, because all have the
    same seeds. The other runs are resolved, and get their ids, when they are requested.
    """

    def __init__(self, plan: Plan, scene: Scene) -> None:
        """Resolve every run.

        Raises a SceneError if the model's timestep is not positive, and the sweep sets no other; or
        if the times of a run's control or hold are inconsistent; a SweepFileError if a run would
        record more than 16 GiB, or more than 1 GiB without a compiler.
        """
        self._plan, self._scene = plan, scene
        # The first run of each shape, in order of appearance.
        self.firsts: dict[Hashable, RunSpec] = {}
        self._kept: list[RunSpec] | None = [] if plan.count <= MAX_KEPT else None
        rows = np.fromiter(self._checked_rows(), np.uint64)
        new, seeds = _first_occurrences(rows), _first_occurrences(np.array(plan.sweep.seed_values))
        self.hash = hash_of_ids([rows[new]])
        """A hash of the first run id of each row; it is the same for every part of the runs."""
        self._distinct = np.outer(new, seeds).ravel()[: plan.count]

    def __len__(self) -> int:
        """Return the number of distinct runs."""
        return int(np.count_nonzero(self._distinct))

    @cached_property
    def ids(self) -> NDArray[np.uint64]:
        """(runs of the plan) the ids in order, including those of equal runs."""
        if self._kept is not None:
            return np.array([int(run.run_id, 16) for run in self._kept], np.uint64)
        rows = (ids for _, _, ids in self._identified_rows())
        return np.fromiter((int(run_id, 16) for ids in rows for run_id in ids), np.uint64)

    def select_ids(self, is_wanted: NDArray[np.bool_]) -> "RunIndex":
        """Return the index of the runs in a mask (runs of the plan)."""
        part = copy(self)
        part._distinct = self._distinct & is_wanted
        return part

    def select_shard(self, number: int, shards: int) -> "RunIndex":
        """Return the index of every `shards`-th run, starting from `number`."""
        part = copy(self)
        places = np.flatnonzero(self._distinct)[number - 1 :: shards]
        part._distinct = np.zeros_like(self._distinct)
        part._distinct[places] = True
        return part

    def count_done(self, finished_ids: Collection[str]) -> int:
        """Return the number of runs that are done."""
        return len(self) - int(np.count_nonzero(self._remaining_mask(finished_ids)))

    def has_run(self, run_id: str, index: int) -> bool:
        """Return whether the run at an index of the plan has this id."""
        return (
            index < len(self._distinct)
            and bool(self._distinct[index])
            and f"{self.ids[index]:016x}" == run_id
        )

    def has_all(self, ids: NDArray[np.uint64], places: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return (n,) whether the runs at these indices of the plan have these ids."""
        is_in_plan = (places >= 0) & (places < len(self._distinct))
        within = np.where(is_in_plan, places, 0)
        return is_in_plan & self._distinct[within] & (self.ids[within] == ids)

    def iterate_runs(self, finished_ids: Collection[str] = ()) -> Iterator[RunSpec]:
        """Yield every run that is not done."""
        is_remaining = self._remaining_mask(finished_ids).tobytes()
        if self._kept is not None:
            yield from (run for run in self._kept if is_remaining[run.index])
            return
        for row, resolved, ids in self._identified_rows(is_remaining):
            for index, (seed, run_id) in enumerate(zip(row.seeds, ids, strict=True), row.first):
                if is_remaining[index]:
                    yield resolved.with_seed(row.values, seed, run_id, index)

    def iterate_rows(self) -> Iterator[tuple[RunSpec, int]]:
        """Yield a run of each row of the plan, and the number of distinct runs of the row."""
        duration = self._plan.sweep.duration
        for row in self._plan.iterate_rows():
            count = np.count_nonzero(self._distinct[row.first : row.first + len(row.seeds)])
            if count:
                yield self._scene.resolve(row.values, row.seeds[0], duration), int(count)

    def _remaining_mask(self, finished_ids: Collection[str]) -> NDArray[np.bool_]:
        """Return (runs of the plan) a mask of the runs that are not done."""
        if not finished_ids:
            return self._distinct
        finished_numbers = np.fromiter(
            (int(run_id, 16) for run_id in finished_ids), np.uint64, len(finished_ids)
        )
        return self._distinct & ~np.isin(self.ids, finished_numbers)

    def _identified_rows(
        self, is_wanted: bytes | None = None
    ) -> Iterator[tuple[Row, RunSpec, Iterator[str]]]:
        """Yield each row with a wanted run, the common part of its runs, and their ids."""
        duration = self._plan.sweep.duration
        for row in self._plan.iterate_rows():
            if is_wanted is None or any(is_wanted[row.first : row.first + len(row.seeds)]):
                yield row, *self._scene.resolve_with_ids(row.values, row.seeds, duration)

    def _checked_rows(self) -> Iterator[int]:
        """Yield the id of each row's first run after checking it; keep all runs if they are few."""
        check = _RunCheck(self._scene)
        for row, resolved, ids in self._identified_rows():
            run = resolved.with_seed(row.values, row.seeds[0], next(ids), row.first)
            # Runs of one shape differ only in the values of settings and initial values.
            parts = tuple(run.axes), tuple(run.structure.values()), tuple(run.flags.values())
            shape = *parts, run.engine, run.drive, run.duration, run.changed_settings, run.without
            check(run, shape)
            self.firsts.setdefault(shape, run)
            if self._kept is not None:
                others = enumerate(zip(row.seeds[1:], ids, strict=True), row.first + 1)
                more = (resolved.with_seed(row.values, seed, own, at) for at, (seed, own) in others)
                self._kept += [run, *more]
            yield int(run.run_id, 16)


def _first_occurrences(values: NDArray[Any]) -> NDArray[np.bool_]:
    """Return (n,) a mask of the first occurrence of each value (n,)."""
    first = np.zeros(len(values), bool)
    first[np.unique(values, return_index=True)[1]] = True
    return first


def _check_size(run: RunSpec, size: int) -> None:
    # Without files, a worker needs three times as much memory, with temporary arrays.
    most_bytes, where, remedy = 1 << 30, "in memory", ""
    if size <= most_bytes:
        return
    if isinstance(memory := load_disk_memory(), str):
        remedy = f", or let it record into files ({memory})"
    else:
        most_bytes, where = 16 << 30, "in files"
    if size > most_bytes:
        raise SweepFileError(
            f"a run of {run.steps:,} steps would record {size / 2**30:.1f} GiB {where}; the limit "
            f"is {most_bytes >> 30} GiB. Shorten `duration`, lengthen `timestep` or monitor fewer "
            f"pairs{remedy}"
        )


class _RunCheck:
    """Checks the settings of runs before anything runs, once for runs that differ only in seed."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._checked: set[object] = set()
        self._least: dict[Hashable, float] = {}

    def __call__(self, run: RunSpec, shape: Hashable) -> None:
        if not run.timestep >= self._least.get(shape, math.inf):
            # A run has steps, and its recording fits into memory.
            if not 0 < run.timestep < math.inf:
                raise SceneError(
                    f"{self._scene.source.model}: its timestep is {run.timestep:g} s; write a "
                    "positive one there, or sweep `timestep`"
                )
            most_steps = 1e12  # weeks of computing, even of a pendulum
            if run.duration / run.timestep > most_steps:
                raise SweepFileError(
                    f"{run.duration:g} s in steps of {run.timestep:g} s are too many; lengthen "
                    "`timestep`"
                )
            _check_size(run, bytes_of_run(self._scene.base_of(run).model, run.steps))
            self._least[shape] = run.timestep
        engine = engine_of(run)
        if isinstance(run.drive, PolicyDrive) and not engine.runs_policies:
            raise SceneError(
                f"the {engine.name} engine cannot run policies; sweep with engine: mujoco, then "
                "drive this engine by a file of the store's controls"
            )
        if not engine.accepts_every_run and (why := engine.refusal(self._scene, run)):
            raise SceneError(why)
        if run.changed_settings & AT_REST.keys():
            self._scene.base_of(run).prepare(run.list_edits())
        driven = run.drive not in ("none", "hold")
        if not driven and not self._scene.is_timed:
            return
        start = tuple(run.settings.get(name) for name in START_SETTINGS)
        # Sines and pushes fit every timestep; noise and recorded controls may not.
        step = run.timestep if driven and run.drive != "exercise" else None
        key = (shape, tuple(sorted(run.initial.items())), start, step)
        if key not in self._checked:
            self._scene.check_start(run)
            # Initial states that are remembered as checked.
            if len(self._checked) < 1 << 12:
                self._checked.add(key)


def pack_jobs(runs: Iterable[RunSpec], count: int, scene: Scene, workers: int) -> Iterator[Job]:
    """Yield jobs, each bounded by `MAX_RUNS`, `JOB_BYTES` and `MODEL_BYTES`, or one run.

    If contacts take more memory than that, the worker makes the runs of a job in parts. Runs that
    are not done yet are consumed lazily, some hundred ahead. Each worker gets several jobs, which
    become smaller towards the end, so that no worker has a large one while the others are idle.
    """
    most, fair = count // (4 * max(1, workers)), -(-count // max(1, workers))
    shares = 2 * workers if workers > 1 else 1
    waiting: dict[Key, list[RunSpec]] = {}
    bounds: dict[Key, tuple[int, int]] = {}
    key, last = Key(), None
    max_open_jobs = 64  # jobs that wait for more runs of their kind; the plan is never kept whole
    for taken_count, run in enumerate(runs):
        if not run.is_sibling(last):
            structure, sleep = run.structure.items(), run.flags.get("sleep")
            key, last = (*structure, run.steps, run.engine, sleep, run.without), run
        if key not in bounds:
            base, steps, engine = scene.base_of(run), run.steps, engine_of(run)
            size, work = engine.least_bytes(base, run), steps * max(1, base.model.nv) ** 2
            short = _SHORT_STEPS // steps
            least = max(LEAST_WORK, min(SMALL_WORK, fair * work)) // work
            if isinstance(run.drive, PolicyDrive) or run.engine == LOOP_ENGINE:
                short = least = 0
            bound = min(MAX_RUNS, max(_USUAL_RUNS, short), JOB_BYTES // size, _max_models(base))
            least = max(1, min(bound, least))
            bounds[key] = least, max(least, min(bound, most))
        group = waiting.setdefault(key, [])
        group.append(run)
        least, bound = bounds[key]
        if len(group) >= min(bound, max(least, (count - taken_count) // shares)):
            yield tuple(waiting.pop(key))
        elif len(waiting) > max_open_jobs:
            yield tuple(waiting.pop(next(iter(waiting))))
    yield from (tuple(group) for group in waiting.values())


def _max_models(base: CompiledScene) -> int:
    """Return the number of models like this one that a worker may hold; at least one."""
    return max(1, MODEL_BYTES // base.size)


def stored_sweep_scene(identity: SweepIdentity, folder: Path) -> Scene:
    """Return the scene of a store's sweep, with its drive, from the store's own files.

    The folder is the store's copy of the scene. Raises a SceneError if it does not compile with
    this engine, or a file has changed.
    """
    source = stored_scene(folder, identity.scene_model, identity.scene)
    scene = Scene(source, ENGINES, read_control_table)
    scene = scene.with_effects(effects_base(identity.resolved.get("effects", {})))
    if (stored := identity.resolved.get("drive")) is None:
        return scene
    drive = parse_drive(stored)
    return scene.with_drive(drive, folder.parent / (LocatedDrive(drive).hash or ""))


_OPENED = WeakKeyDictionary[Store, Scene]()


def open_store_scene(store: Store) -> Scene:
    """Return the scene of a finished store, which is opened once; see `stored_sweep_scene`."""
    if store not in _OPENED:
        _OPENED[store] = stored_sweep_scene(store.manifest.sweep, store.scene_folder)
    return _OPENED[store]


def keep_scene(store: Store, scene: Scene) -> None:
    """Keep the scene that the runs of a store were planned with, for `open_store_scene`."""
    _OPENED[store] = scene


def local_scene(store: Address, folder: Path) -> Path:
    """Return a local folder with a store's scene, fetched from object storage if necessary.

    `folder` is on the machine that runs the sweep; its name is the scene's hash.
    """
    if folder.is_dir():
        return folder
    return backend_at(store, OutputError).local_folder(SCENES) / folder.name


class Preparer:
    """Prepares the runs of one sweep; its scene is the store's copy."""

    def __init__(self, task: Task, marker: Path | None) -> None:
        silence_mujoco()
        self.task = task
        share_detected(task.detected)
        folder = local_scene(task.store, task.scene_folder)
        self.scene = stored_sweep_scene(task.identity, folder)
        if self.scene.hash != task.scene_folder.name:
            raise StoreError(f"{folder} was changed: its files have the hash {self.scene.hash}")
        self._marker = marker
        self._models: OrderedDict[tuple[str, bool], PreparedModel] = OrderedDict()

    def plan_job(self, job: Job) -> list[PlannedModel]:
        """Return model and initial state of each run of a job of one structure."""
        starts = self.scene.initial_states(job)
        plans: list[PlannedModel] = []
        key, last = "", None
        for place, run in enumerate(job):
            start = self._with_recorded_actions(run, starts.select_run(place))
            if not run.is_sibling(last):
                key, last = self.scene.model_key(run), run
            plans.append(PlannedModel(run, self._prepared_model(key, run, start), start))
        return plans

    def _with_recorded_actions(self, run: RunSpec, start: InitialStates) -> InitialStates:
        """Return the start of a run, with the recorded actions of its policy if there are any."""
        if run.controls is None:
            return start
        backend = backend_at(self.task.store, OutputError)
        return start.with_recorded_inputs([read_controls(backend, run.controls)])

    def _prepared_model(self, shared: str, run: RunSpec, start: InitialStates) -> PreparedModel:
        base = self.scene.base_of(run)
        key = shared, is_straight(base.model, start)
        if key not in self._models:
            compiled = base.motion_model if run.engine == MODEL_ENGINE else None
            self._models[key] = self.scene.prepare(run, start, compiled)
            # Small models are limited by number, and large ones by their bytes.
            most = min(64, _max_models(base))
            while len(self._models) > most:
                self._models.popitem(last=False)
        self._models.move_to_end(key)
        return self._models[key]

    @contextmanager
    def start_watchdog(self, times: float = 1) -> Generator[Watch]:
        """Yield the function that starts the time limit of a run, which ends this process.

        The limit is `times` the limit of the sweep, and holds even if a run never returns to
        Python: the process dies of SIGALRM, and its traceback is in the marker, which is empty
        otherwise.
        """
        if self._marker is None:
            yield no_limit
            return
        with self._marker.open("w") as file:
            # A timer takes one system call; faulthandler's own starts a thread each time.
            faulthandler.register(signal.SIGALRM, file=file, all_threads=False, chain=True)
            try:
                yield partial(_set_alarm, times * self.task.sweep.timeout)
            finally:
                signal.setitimer(signal.ITIMER_REAL, 0)
                faulthandler.unregister(signal.SIGALRM)


def _set_alarm(seconds: float) -> None:
    signal.setitimer(signal.ITIMER_REAL, seconds)
