"""Runs a sweep into a store: plan, skip finished runs, run the rest, publish."""

import logging
from collections.abc import Generator, Iterable, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from itertools import chain, islice
from pathlib import Path
from typing import Any

from pydantic_core import PydanticSerializationError

from contactlab.engines import engine_of
from contactlab.engines.closed_loop import allowed_policy
from contactlab.engines.contact_kernel import reason_for_sensors
from contactlab.errors import PluginError, SweepFileError
from contactlab.measure import LABELS, METRICS, added_labels
from contactlab.plan.grid import Plan
from contactlab.plugins import loaded_plugins
from contactlab.run.chosen_runs import ChosenRuns, RefinedRuns, RunsUntilKnown, SearchedRuns
from contactlab.run.evidence_record import find_engine, find_provenance, hash_definitions
from contactlab.run.parameter_budgets import parameter_budgets
from contactlab.run.passes import SweepSession, results_of_pass, run_passes
from contactlab.run.planned_runs import RunIndex, pack_jobs
from contactlab.run.repeated_runs import find_unrepeatable
from contactlab.run.resumed_sweep import (
    keep_stored_identity,
    keep_stored_scene,
    read_stored_identity,
)
from contactlab.run.run_verdicts import conclude_runs
from contactlab.run.shards import shard_of_sweep
from contactlab.run.sweep_advisories import find_sweep_advisories
from contactlab.run.sweep_request import Chooser, SweepRequest
from contactlab.run.tasks import (
    BeginCallback,
    CrashedJob,
    Executor,
    FinishedRun,
    Job,
    ProgressCallback,
    Stop,
    Task,
    notes_by_run,
    results_of,
)
from contactlab.run.worker import Worker
from contactlab.run.worker_pool import LocalPool
from contactlab.scene.drive.located_drive import LocatedDrive
from contactlab.scene.effects.effect_table import EFFECTS
from contactlab.scene.model_edits import MODEL_ENGINE
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene
from contactlab.schema.drive import PolicyDrive
from contactlab.schema.evidence import (
    RECORD_VERSION,
    LabelEntry,
    PluginInfo,
    StoreManifest,
    SweepIdentity,
)
from contactlab.schema.sweep_schema import Sweep
from contactlab.store.store_writer import StoreWriter, open_writer
from contactlab.store.table_layout import (
    PLUGINS_COLUMN,
    REAL,
    RESERVED_COLUMNS,
    Column,
    axis_column,
    struct_column,
)

_LOG = logging.getLogger(__name__)


def run_sweep(
    request: SweepRequest,
    begin: BeginCallback,
    progress: ProgressCallback,
    stop: Stop | None = None,
    index: RunIndex | None = None,
) -> StoreManifest:
    """Run everything that is not stored yet and publish the store.

    The index, if known, is that of the request's runs. Raises a SweepFileError if the sweep has no
    runs, or cannot be run; an OutputError if the store cannot be written; a StoreError if the store
    is of another sweep; a StoppedError if `stop` was set. The same call resumes a stopped sweep.
    """
    drive = request.scene.drive
    policy = allowed_policy(drive, allowed=request.allow_code)
    if index is None:
        index = RunIndex(request.plan, request.scene)
    if not len(index):
        raise SweepFileError(f"sweep '{request.name}' has no runs; see `--plan`")
    stored = None if request.fresh else read_stored_identity(request.store)
    stored_request, files = keep_stored_scene(request, stored, index.firsts.values())
    if stored_request is not request:
        _LOG.info("the files of the scene are written differently; runs use the store's copy")
        request, index = stored_request, RunIndex(stored_request.plan, stored_request.scene)
    # Columns of axes are typed by their values; an environment adds some of its own.
    firsts, own = index.firsts.values(), request.scene.source.environment
    names = dict.fromkeys(chain.from_iterable(run.axes for run in firsts))
    axes = [_axis_column(request, name) for name in names]
    columns = [*axes, *measured_columns(firsts, names), *(own.columns if own else ())]
    identity = identity_of(request, index)
    if request.shard:
        index, identity = shard_of_sweep(request.shard, request.plan.sweep, index, identity)
    identity = keep_stored_identity(stored, identity)
    writer = open_writer(
        request.store,
        identity,
        files,
        fresh=request.fresh,
        retry_failed=request.retry_failed,
        repair=request.repair,
        is_planned=index.has_run,
        # The files of the sweep's drive, in a folder of their own; a scene has its own.
        more_files={drive.hash: drive} if request.plan.sweep.drive and drive.hash else {},
    )
    with writer as store:
        if isinstance(store, StoreManifest):
            stored = min(len(index), store.runs)
            begin(stored, stored)
            return store
        task = make_task(request, identity, store, policy)
        executor, stop = request.cluster or LocalPool(request.workers), stop or Stop()
        session = SweepSession(task, request.scene, store, index, executor, stop, begin, progress)
        if chosen := chosen_runs(request.plan, index, request.choose):
            session, identity = _run_chosen(session, chosen)
        else:
            session.begin(len(index), index.count_done(store.done))
            _run_missing(session)
        values, added = run_passes(session)
        columns += added
        shared = shared_fields(identity)
        # A shard cannot conclude over all runs.
        plan, budgets = (None, ()) if request.shard else (request.plan, parameter_budgets(session))
        met_advisories = tuple(each.id for each, _ in find_sweep_advisories(index, request.scene))
        unrepeatable = _repeat_some(session)
        conclusion = partial(conclude_runs, plan, [*budgets], met_advisories, unrepeatable)
        return store.finish_store(columns, shared, task.provenance, values, identity, conclusion)


def shared_fields(identity: SweepIdentity) -> dict[str, object]:
    """Return the fields that the records of a store share."""
    added = added_labels()
    return {
        "schema_version": RECORD_VERSION,
        "sweep": identity.name,
        "units": {name: metric.unit for name, metric in METRICS.items()},
        "metric_versions": identity.metric_versions,
        "severity": list(LABELS),
        **({"labels": added} if added else {}),
    }


def chosen_runs(plan: Plan, index: RunIndex, choose: Chooser | None = None) -> ChosenRuns | None:
    """Return the chooser of a plan's runs, if the choice depends on earlier results."""
    sweep = plan.sweep
    if choose:
        return choose(plan, index.ids)
    if sweep.refining:
        return RefinedRuns(sweep.refining, plan, index.ids)
    if sweep.until:
        return RunsUntilKnown(sweep.until, plan, index.ids)
    return SearchedRuns(sweep.search, plan, index.ids) if sweep.search else None


def _run_chosen(session: SweepSession, chosen: ChosenRuns) -> tuple[SweepSession, SweepIdentity]:
    """Make the runs that are chosen by earlier results, round by round.

    Return the session with the runs in the store then, and their identity.
    """
    whole, store = session.index, session.store
    chosen.add_rows(store.read_rows())
    chosen.learn_notes(notes_by_run(store.read_notes(), "outcomes"))
    stored = whole.count_done(store.done)

    def learn(finished: Sequence[FinishedRun]) -> None:
        chosen.learn_finished(finished)
        session.progress(finished)

    while (is_chosen := chosen.next_runs()).any():
        index = whole.select_ids(is_chosen)
        if chosen.purpose != "record":
            jobs = pack_jobs(
                index.iterate_runs(), len(index), session.scene, session.executor.workers
            )
            chosen.learn_notes(results_of_pass(session, chosen.purpose, [*jobs]))
            continue
        session.begin(stored + len(index), stored)
        _run_missing(replace(session, index=index, progress=learn))
        stored = 0
    index, identity = chosen.finished_part(whole, store.identity)
    return replace(session, index=index), identity


def _repeat_some(session: SweepSession) -> tuple[str, ...]:
    task, runs = session.task, session.index.iterate_runs()
    if task.policy is None or session.stop.is_set:
        return ()
    drive = task.policy.drive
    if not session.executor.workers and isinstance(drive, PolicyDrive) and drive.runs_code:
        _LOG.warning(
            "with --workers 0 a run is repeated in this process only, so a policy that depends on "
            "its process is not noticed"
        )
    some = [*islice(runs, 1)]
    unrepeatable = find_unrepeatable(task, some, session.executor.workers, session.stop)
    for run_id in unrepeatable:
        _LOG.warning(
            "run %s does not repeat: simulated again, its motion or controls differed; the policy "
            "may draw from a generator without a seed, read a clock, or depend on its process",
            run_id,
        )
    return unrepeatable


def _run_missing(session: SweepSession) -> None:
    index, store, executor = session.index, session.store, session.executor
    done_count = index.count_done(store.done)
    native = session.task.policy is None and isinstance(executor, LocalPool)
    native &= MODEL_ENGINE in {run.engine for run in index.firsts.values()}
    if native and done_count < len(index) and (reason := reason_for_sensors()):
        _LOG.warning("contacts are read by sensors, which takes longer: %s", reason)
    rest = index.iterate_runs(store.done)
    jobs = pack_jobs(rest, len(index) - done_count, session.scene, executor.workers)
    # Closed at once if a row is interrupted: workers end before the store removes temporary files.
    with closing(run_all_jobs(session.task, jobs, executor, session.stop)) as results:
        for finished in results:
            store.append_rows(
                [record.row for record in finished], finished[0].shared if finished else b""
            )
            session.progress(finished)


def make_task(
    request: SweepRequest,
    identity: SweepIdentity,
    store: StoreWriter,
    policy: LocatedDrive | None,
) -> Task:
    """Return the data that all jobs of a sweep share; the code of a policy must be allowed."""
    return Task(
        sweep=request.plan.sweep,
        expected=request.plan.expected,
        identity=identity,
        store=where.resolve() if isinstance(where := request.store, Path) else where,
        scene_folder=store.scene_folder.resolve(),
        provenance=find_provenance(),
        plugins=loaded_plugins(),
        policy=policy,
        environment=request.scene.source.environment,
        detected=request.scene.find_detected(),
    )


def identity_of(request: SweepRequest, index: RunIndex) -> SweepIdentity:
    """Return the definition of a sweep's runs; see `run_sweep` for errors."""
    scene, sweep = request.scene, request.plan.sweep
    manifest, drives = scene.source.manifest, [run.drive for run in index.firsts.values()]
    moved = any(drive not in ("none", "hold") for drive in drives)
    has_inputs = bool(manifest and manifest.control) or moved
    engines = {run.engine: engine_of(run) for run in index.firsts.values()}.values()
    lacking = [engine_class.null_fields(driven=has_inputs).items() for engine_class in engines]
    lacking += [own.missing_fields(sweep).items()] if (own := scene.source.environment) else []
    # The first baseline row of the grid, with the first seed.
    baseline = [
        scene.run_id(scene.resolve(row, sweep.seed_values[0], sweep.duration))
        for row in request.plan.grid.baseline_rows[:1]
    ]
    identity = SweepIdentity(
        **identity_fields(request.name, scene, sweep),
        source=request.source,
        overrides=request.overrides,
        runs_asked=len(index),
        baseline=baseline[0] if baseline else None,
        lacking=dict(chain.from_iterable(lacking)),
        plan_hash=index.hash,
    )
    try:
        identity.model_dump_json()
    except PydanticSerializationError as error:
        raise SweepFileError(
            "a name of the sweep, the scene or a file is not UTF-8 text; rename it, or set "
            "LC_ALL=C.UTF-8"
        ) from error
    return identity


def identity_fields(name: str, scene: Scene, sweep: Sweep) -> dict[str, Any]:
    """Return the fields of a store's identity about a sweep, a scene and this code."""
    return {
        "name": name,
        # Keep the identity of sweeps from versions without drives.
        "resolved": sweep.model_dump(
            mode="json", exclude={"drive"} if sweep.drive is None else None
        ),
        "scene": scene.name,
        "scene_hash": scene.hash,
        "scene_model": scene.source.content.model.as_posix(),
        "engine": find_engine(),
        "metric_versions": {name: metric.version for name, metric in METRICS.items()},
        "definitions": hash_definitions(),
        "plugins": tuple(
            PluginInfo(name=plugin.name, version=plugin.version, sha256=plugin.sha256)
            for plugin in loaded_plugins()
        ),
    }


def measured_columns(runs: Iterable[RunSpec], axes: Iterable[str] = ()) -> list[Column]:
    """Return the columns of metrics, and of the settings and effects of runs.

    A PluginError names a metric with the name of another column, such as that of an axis.
    """
    if clashing_names := sorted(METRICS.keys() & {*RESERVED_COLUMNS, *axes}):
        raise PluginError(
            f"'{clashing_names[0]}' is the name of a column of this table; rename the metric"
        )
    metrics = [
        Column(m.name, REAL, m.unit, m.definition, m.better, m.resolution, m.kind == "check")
        for m in METRICS.values()
    ]
    settings = struct_column("settings", (run.values for run in runs))
    effects = struct_column("effects", [dict.fromkeys(EFFECTS, True)])
    plugins = [PLUGINS_COLUMN] if loaded_plugins() else []
    return [*metrics, settings, effects, *plugins]


def _axis_column(request: SweepRequest, name: str) -> Column:
    spec = request.scene.catalogue.find_axis(name)
    assert spec is not None
    try:
        return axis_column(name, request.plan.grid.axis_values(name), spec.unit, spec.description)
    except ValueError as error:
        raise SweepFileError(f"axis '{name}' {error}") from error


def run_all_jobs(
    task: Task, jobs: Iterable[Job], executor: Executor, stop: Stop
) -> Generator[list[FinishedRun]]:
    """Yield the results of every job, once for each run.

    The runs of a crashed job are run again one by one. The culprit is the run that then times out,
    or that crashes twice alone: once may be chance, for example if other runs need the memory.
    Raises a StoppedError if `stop` was set; crashed jobs are then left for the next time.
    """
    recorder: Worker | None = None
    # Crashes of a run alone before it counts as the culprit; its first job may crash once more.
    max_crashes_alone = 2
    for crashes in range(max_crashes_alone + 1):
        crashed: list[Job] = []
        for result in results_of(task, jobs, executor, stop):
            if not isinstance(result, CrashedJob):
                yield result
            elif crashes == max_crashes_alone or (crashes and result.timed_out):
                (run,), reason = result.job, result.reason
                reason = f"over {task.sweep.timeout:g} s: {reason}" if result.timed_out else reason
                label = "timeout" if result.timed_out else "crashed"
                recorder = recorder or Worker(task, None)
                yield [
                    recorder.record_crash(run, LabelEntry(label=label, reason=reason, step=None))
                ]
            else:
                crashed.append(result.job)
        if not crashed:
            return
        jobs = [(run,) for job in crashed for run in job]
