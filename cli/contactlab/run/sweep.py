"""Run a sweep into a store: plan, skip what is done, run the rest, publish."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from contactlab.errors import SweepFileError
from contactlab.measure import CHECKS, LABELS, METRICS, Metric
from contactlab.plan import Plan
from contactlab.run.job import Begin, Executor, Progress, Task
from contactlab.run.jobs import pack
from contactlab.run.lost import run_all
from contactlab.run.passes import Session, run_passes
from contactlab.run.pool import LocalPool
from contactlab.run.provenance import engine, provenance
from contactlab.run.record import UNITS, VERSIONS, as_written
from contactlab.run.roster import Roster
from contactlab.run.stop import Stop
from contactlab.scene import EFFECTS, Scene, null_fields
from contactlab.schema import RECORD_VERSION, StoreManifest, SweepIdentity
from contactlab.store import (
    Address,
    Column,
    StoreWriter,
    absolute_address,
    axis_column,
    metric_column,
    open_writer,
    struct_column,
)


@dataclass(frozen=True)
class Ask:
    """A sweep to run.

    Attributes:
        plan: its runs.
        scene: its scene.
        name: the sweep's name.
        source: the sweep file's text.
        overrides: options that changed it, as given.
        store: where the store is written.
        workers: processes; 0 for none but this one.
        fresh: whether to replace a store that is there.
        left_out: why runs are left out of the plan that only newer engines can do.
        cluster: where runs are computed, if not by worker processes of this machine.
        retry_failed: whether stored runs that failed are run again.
    """

    plan: Plan
    scene: Scene
    name: str
    source: str
    overrides: tuple[str, ...]
    store: Address
    workers: int
    fresh: bool = False
    left_out: tuple[str, ...] = ()
    cluster: Executor | None = None
    retry_failed: bool = False

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
        StoppedError: it was told to stop; the store is resumable.
    """
    roster = Roster(ask.plan, ask.scene)
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
    roster, store, executor = session.roster, session.store, session.executor
    done = roster.count(store.done)
    session.begin(len(roster), done)
    rest = roster.runs(store.done)
    jobs = pack(rest, len(roster) - done, session.scene, executor.workers)
    for finished in run_all(session.task, jobs, executor, session.stop):
        store.append([each.row for each in finished])
        session.progress(finished)


def _task(ask: Ask, store: StoreWriter, runs: int) -> Task:
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


def _identity(ask: Ask, roster: Roster) -> SweepIdentity:
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
        metric_versions=VERSIONS,
        runs_asked=len(roster),
        lacking=null_fields(driven=bool(manifest and manifest.control)),
        plan_hash=roster.hash,
    )


def _shared(ask: Ask) -> Mapping[str, Any]:
    return {
        "schema_version": RECORD_VERSION,
        "sweep": ask.name,
        "units": UNITS,
        "metric_versions": VERSIONS,
        "severity": list(LABELS),
    }


def _columns(ask: Ask, roster: Roster) -> list[Column]:
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
        second_pass=metric in CHECKS,
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
