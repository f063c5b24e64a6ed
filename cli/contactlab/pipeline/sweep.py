"""Run a sweep into a store: plan, skip what is done, run the rest, publish."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from contactlab.errors import SweepFileError
from contactlab.evidence import (
    Column,
    StoreWriter,
    axis_column,
    metric_column,
    struct_column,
    writing,
)
from contactlab.measure import CHECKS, LABELS, METRICS, Metric
from contactlab.pipeline.job import Begin, Executor, PlannedRun, Progress, Task
from contactlab.pipeline.jobs import Planned, pack, planned_runs
from contactlab.pipeline.lost import run_all
from contactlab.pipeline.passes import Session, run_passes
from contactlab.pipeline.pool import LocalPool
from contactlab.pipeline.provenance import engine, provenance
from contactlab.pipeline.record import UNITS, VERSIONS, as_written
from contactlab.pipeline.stop import Stop
from contactlab.plan import Plan
from contactlab.scene import EFFECTS, Scene, lacking_records
from contactlab.schema import RECORD_VERSION, StoreManifest, SweepIdentity


@dataclass(frozen=True)
class Ask:
    """A sweep to run.

    Attributes:
        plan: its runs.
        scene: its scene.
        name: the sweep's name.
        source: the sweep file's text.
        overrides: options that changed it, as given.
        store: the folder to write.
        workers: processes; 0 for none but this one.
        fresh: whether to replace a store that is there.
        left_out: why runs are left out of the plan that only newer engines can do.
        cluster: where runs are computed, if not by worker processes of this machine.
    """

    plan: Plan
    scene: Scene
    name: str
    source: str
    overrides: tuple[str, ...]
    store: Path
    workers: int
    fresh: bool = False
    left_out: tuple[str, ...] = ()
    cluster: Executor | None = None

    @property
    def executor(self) -> Executor:
        """Where runs are computed."""
        return self.cluster or LocalPool(self.workers)


def run_sweep(
    ask: Ask, begin: Begin, progress: Progress, stop: Stop | None = None
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
    """
    planned = list(planned_runs(ask.plan, ask.scene))
    if not planned:
        raise SweepFileError(f"sweep '{ask.name}' has no runs; see `--plan`")
    columns = _columns(ask, planned)
    identity = _identity(ask, [run for run, _ in planned])
    with writing(ask.store, identity, ask.scene.source.content, fresh=ask.fresh) as store:
        if isinstance(store, StoreManifest):
            begin(len(planned), len(planned))
            return store
        session = Session(
            task=_task(ask, store, len(planned)),
            scene=ask.scene,
            store=store,
            planned=planned,
            executor=ask.executor,
            stop=stop or Stop(),
            begin=begin,
            progress=progress,
        )
        _run_rest(session)
        found = run_passes(session)
        columns = [*columns, *found.columns]
        return store.finish(columns, _shared(ask), session.task.provenance, found.values)


def _run_rest(session: Session) -> None:
    planned, store, executor = session.planned, session.store, session.executor
    rest = [each for each in planned if each[0].run_id not in store.done]
    session.begin(len(planned), len(planned) - len(rest))
    jobs = pack(rest, session.scene, executor.workers)
    for finished in run_all(session.task, jobs, executor, session.stop):
        store.append([each.row for each in finished])
        session.progress(finished)


def _task(ask: Ask, store: StoreWriter, runs: int) -> Task:
    return Task(
        sweep=ask.plan.sweep,
        expected=ask.plan.expected,
        name=ask.name,
        runs=runs,
        store=ask.store.resolve(),
        scene=ask.scene.name,
        scene_folder=store.scene_folder.resolve(),
        scene_model=ask.scene.source.content.model.as_posix(),
        engine=engine(),
        provenance=provenance(),
    )


def _identity(ask: Ask, runs: Sequence[PlannedRun]) -> SweepIdentity:
    manifest = ask.scene.source.manifest
    digest = hashlib.sha256("".join(run.run_id for run in runs).encode())
    return SweepIdentity(
        name=ask.name,
        source=ask.source,
        overrides=ask.overrides,
        resolved=ask.plan.sweep.model_dump(mode="json"),
        scene=ask.scene.name,
        scene_hash=ask.scene.hash,
        scene_model=ask.scene.source.content.model.as_posix(),
        engine=engine(),
        metric_versions=VERSIONS,
        runs_asked=len(runs),
        lacking=lacking_records(driven=bool(manifest and manifest.control)),
        plan_hash=digest.hexdigest()[:32],
    )


def _shared(ask: Ask) -> Mapping[str, Any]:
    return {
        "schema_version": RECORD_VERSION,
        "sweep": ask.name,
        "units": UNITS,
        "metric_versions": VERSIONS,
        "severity": list(LABELS),
    }


def _columns(ask: Ask, planned: Planned) -> list[Column]:
    """Return the columns of axes, typed by their values, of metrics, settings and effects."""
    values: dict[str, dict[object, None]] = {}
    settings: dict[str, object] = {}
    for run, resolved in planned:
        settings |= resolved.values
        for name, value in run.values.items():
            values.setdefault(name, {})[as_written(value)] = None
    for name, taken in values.items():
        if len({isinstance(value, str) for value in taken}) > 1:
            raise SweepFileError(
                f"axis '{name}' mixes single numbers with lists of them; write all as lists"
            )
    axes = [_axis_column(ask.scene, name, list(taken)) for name, taken in values.items()]
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
        second_pass=metric in CHECKS,
    )


def _axis_column(scene: Scene, name: str, values: Sequence[object]) -> Column:
    spec = scene.catalogue.find(name)
    assert spec is not None
    return axis_column(name, values, spec.unit, spec.description)
