"""Run a sweep into a store: plan, skip what is done, run the rest, publish."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from contactlab.errors import SweepFileError
from contactlab.measure import LABELS, METRICS, Metric
from contactlab.run.evidence_record import (
    as_written,
    engine,
    metric_units,
    metric_versions,
    provenance,
)
from contactlab.run.passes import Session, run_passes
from contactlab.run.planned_runs import RunIndex, pack_jobs
from contactlab.run.sweep_request import SweepRequest
from contactlab.run.tasks import (
    BeginCallback,
    Crashed,
    Executor,
    Finished,
    Job,
    ProgressCallback,
    Stop,
    Task,
    results_of,
)
from contactlab.run.worker import Worker
from contactlab.run.worker_pool import LocalPool
from contactlab.scene import EFFECTS, Scene, null_fields
from contactlab.schema import RECORD_VERSION, LabelEntry, StoreManifest, SweepIdentity
from contactlab.store import (
    Column,
    StoreWriter,
    absolute_address,
    axis_column,
    metric_column,
    open_writer,
    struct_column,
)


def run_sweep(
    ask: SweepRequest, begin: BeginCallback, progress: ProgressCallback, stop: Stop | None = None
) -> StoreManifest:
    """Run what is not stored yet and publish the store.

    Args:
        ask: the sweep.
        begin: told how many runs there are and how many of them are done already.
        progress: told of runs as they finish.
        stop: set when the sweep should end soon.

    Raises:
        SweepFileError: the sweep cannot be run as asked.
        OutputError: the store cannot be written.
        StoreError: the store is another sweep's.
        StoppedError: it was told to stop; the store is resumable.
    """
    roster = RunIndex(ask.plan, ask.scene)
    if not len(roster):
        raise SweepFileError(f"sweep '{ask.name}' has no runs; see `--plan`")
    columns = _columns(ask, roster)
    identity = _identity(ask, roster)
    content = ask.scene.source.content
    begun = open_writer(
        ask.store, identity, content, fresh=ask.fresh, retry_failed=ask.retry_failed
    )
    with begun as store:
        if isinstance(store, StoreManifest):
            begin(len(roster), len(roster))
            return store
        session = Session(
            task=_task(ask, store, len(roster)),
            scene=ask.scene,
            store=store,
            roster=roster,
            executor=ask.cluster or LocalPool(ask.workers),
            stop=stop or Stop(),
            begin=begin,
            progress=progress,
        )
        _run_remaining(session)
        found = run_passes(session)
        columns = [*columns, *found.columns]
        return store.finish(columns, _shared(ask), session.task.provenance, found.values)


def _run_remaining(session: Session) -> None:
    roster, store, executor = session.roster, session.store, session.executor
    done = roster.count(store.done)
    session.begin(len(roster), done)
    rest = roster.runs(store.done)
    jobs = pack_jobs(rest, len(roster) - done, session.scene, executor.workers)
    for finished in run_all_jobs(session.task, jobs, executor, session.stop):
        store.append([each.row for each in finished])
        session.progress(finished)


def _task(ask: SweepRequest, store: StoreWriter, runs: int) -> Task:
    return Task(
        sweep=ask.plan.sweep,
        expected=ask.plan.expected,
        name=ask.name,
        runs=runs,
        store=absolute_address(ask.store),
        scene=ask.scene.name,
        scene_folder=store.scene_folder.resolve(),
        scene_model=ask.scene.source.content.model.as_posix(),
        engine=engine(),
        provenance=provenance(),
    )


def _identity(ask: SweepRequest, roster: RunIndex) -> SweepIdentity:
    manifest = ask.scene.source.manifest
    return SweepIdentity(
        name=ask.name,
        source=ask.source,
        overrides=ask.overrides,
        resolved=ask.plan.sweep.model_dump(mode="json"),
        scene=ask.scene.name,
        scene_hash=ask.scene.hash,
        scene_model=ask.scene.source.content.model.as_posix(),
        engine=engine(),
        metric_versions=metric_versions(),
        runs_asked=len(roster),
        lacking=null_fields(driven=bool(manifest and manifest.control)),
        plan_hash=roster.hash,
    )


def _shared(ask: SweepRequest) -> Mapping[str, Any]:
    return {
        "schema_version": RECORD_VERSION,
        "sweep": ask.name,
        "units": metric_units(),
        "metric_versions": metric_versions(),
        "severity": list(LABELS),
    }


def _columns(ask: SweepRequest, roster: RunIndex) -> list[Column]:
    """Return the columns of axes, typed by their values, of metrics, settings and effects."""
    values: dict[str, Sequence[object]] = {}
    settings: dict[str, object] = {}
    for shape, first in roster.firsts.items():
        settings |= shape.first.values
        values |= {name: [value] for name, value in first.items()}
    values |= {axis.name: axis.values for axis in ask.plan.axes if axis.name in values}
    axes = [_axis_column(ask.scene, name, taken) for name, taken in values.items()]
    metrics = [_metric_column(metric) for metric in METRICS.values()]
    effects = struct_column("effects", dict.fromkeys(EFFECTS, True))
    return [*axes, *metrics, struct_column("settings", settings), effects]


def _metric_column(metric: Metric) -> Column:
    return metric_column(
        metric.name,
        metric.unit,
        metric.definition,
        better=metric.better,
        resolution=metric.resolution,
        second_pass=metric.kind == "check",
    )


def _axis_column(scene: Scene, name: str, values: Sequence[object]) -> Column:
    spec = scene.catalogue.find(name)
    assert spec is not None
    written = [as_written(value) for value in values]
    if len({isinstance(value, str) for value in written}) > 1:
        raise SweepFileError(
            f"axis '{name}' mixes single numbers with lists of them; write all as lists"
        )
    return axis_column(name, written, spec.unit, spec.description)


def run_all_jobs(
    task: Task, jobs: Iterable[Job], executor: Executor, stop: Stop
) -> Iterator[list[Finished]]:
    """Yield what comes of every job, once for each run.

    A job that is lost is run again, run by run. A run that then runs out of time is the culprit, or
    one that is lost twice by itself: once may be chance, as when others need the memory.

    Raises:
        StoppedError: the sweep was wished to stop; lost jobs are left for another time.
    """
    lost: list[Job] = []
    for result in results_of(task, jobs, executor, stop):
        if isinstance(result, Crashed):
            lost.append(result.job)
        else:
            yield result
    for last in (False, True):
        if not lost:
            return
        recorder = Worker(task, None)
        alone, lost = [(run,) for job in lost for run in job], []
        for result in results_of(task, alone, executor, stop):
            if not isinstance(result, Crashed):
                yield result
            elif last or result.timed_out:
                yield [_record_crash(task, recorder, result)]
            else:
                lost.append(result.job)


def _record_crash(task: Task, recorder: Worker, lost: Crashed) -> Finished:
    (run,) = lost.job
    label = "timeout" if lost.timed_out else "crashed"
    reason = f"over {task.sweep.timeout:g} s: {lost.reason}" if lost.timed_out else lost.reason
    return recorder.lost(run, LabelEntry(label=label, reason=reason, step=None))
