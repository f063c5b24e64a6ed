"""The passes over a sweep's runs once all are recorded: errors, work and times."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from contactlab.accuracy.discretization import Note, accuracies, families
from contactlab.accuracy.timing import InterleavedTimer, timings
from contactlab.engines import engine_of
from contactlab.engines.engine import SimulationEngine, SolvesReferences, TimesSteps
from contactlab.errors import OutputError
from contactlab.run.planned_runs import Planned, RunIndex, pack_jobs, reference_models
from contactlab.run.run_verdicts import within_tolerances
from contactlab.run.tasks import (
    BeginCallback,
    Crashed,
    Executor,
    Finished,
    Job,
    ProgressCallback,
    Purpose,
    Stop,
    Task,
    note,
    noted,
    results_of,
)
from contactlab.scene.resolution import ResolvedRun
from contactlab.scene.scene import Scene
from contactlab.schema.evidence import ERRORS, Accuracy, Timing
from contactlab.schema.sweep_schema import AccuracyRequest
from contactlab.store.controls_file import read_controls
from contactlab.store.folder_backend import backend_at
from contactlab.store.store_writer import StoreWriter
from contactlab.store.table_layout import Column, as_ratios


@dataclass(frozen=True)
class SweepSession:
    """A sweep that is running, and what runs it."""

    task: Task
    scene: Scene
    store: StoreWriter
    index: RunIndex
    executor: Executor
    stop: Stop
    begin: BeginCallback
    progress: ProgressCallback

    @cached_property
    def outcomes(self) -> dict[str, Mapping[str, Any]]:
        """What later passes need of each row, by run id: no errors are in it yet."""
        tolerances = self.task.sweep.tolerances.keys() - set(ERRORS)
        names = ("status", "controls", *tolerances)
        return {row["run_id"]: {name: row.get(name) for name in names} for row in self.store.rows()}

    @cached_property
    def planned(self) -> Planned:
        """All of its runs at once, with their settings; only small sweeps have passes."""
        return list(self.index.runs())

    def repeatable(self, able: Callable[[SimulationEngine], bool]) -> Planned:
        """Return the runs that completed and whose engine is able; no others are repeated."""
        return [
            (replace(run, controls=row["controls"]), resolved)
            for run, resolved in self.planned
            if (row := self.outcomes[run.run_id])["status"] == "ok" and able(engine_of(resolved))
        ]


def run_passes(session: SweepSession) -> tuple[dict[str, dict[str, Any]], Sequence[Column]]:
    """Compute the errors, work and times that the sweep asks for, by run id and column.

    What was noted before an interruption is not done again. Columns whose unit is not the usual one
    are returned, too.
    """
    values: dict[str, dict[str, Any]] = {}
    columns: Sequence[Column] = ()
    sweep = session.task.sweep
    if sweep.accuracy is not None:
        errors = _accuracies(session, sweep.accuracy)
        values = {run_id: _row(session, run_id, each) for run_id, each in errors.items()}
        if any(each.error_kind == "invariants" for each in errors.values()):
            columns = as_ratios(name for name in Accuracy.model_fields if name.startswith("error_"))
    if sweep.timing is not None:
        for run_id, timing in _timings(session, sweep.timing.rounds).items():
            values[run_id] = values.get(run_id, {}) | timing.model_dump()
    return values, columns


def _accuracies(session: SweepSession, request: AccuracyRequest) -> dict[str, Accuracy]:
    repeatable = session.repeatable(lambda engine: isinstance(engine, SolvesReferences))
    runs = {run.run_id: run for run, _ in repeatable}
    controls = {run_id: run.controls for run_id, run in runs.items()}
    models = reference_models(session.scene, session.task.sweep, repeatable)
    grouped = families(models, session.scene, controls)
    notes = _pooled(session, "errors", [tuple(map(runs.__getitem__, each)) for each in grouped])
    return accuracies(request, session.scene, _resolved(session.planned), notes)


def _resolved(planned: Planned) -> dict[str, ResolvedRun]:
    return {run.run_id: resolved for run, resolved in planned}


def _row(session: SweepSession, run_id: str, accuracy: Accuracy) -> dict[str, Any]:
    """Return the columns of a run's accuracy, and whether it still meets every tolerance."""
    row = accuracy.model_dump()
    metrics = {**session.outcomes[run_id], **{name: row[name] for name in ERRORS}}
    return {**row, "tolerances_met": within_tolerances(session.task.sweep.tolerances, metrics)}


def _timings(session: SweepSession, rounds: int) -> dict[str, Timing]:
    runs = session.repeatable(lambda engine: isinstance(engine, TimesSteps))
    jobs = list(pack_jobs(runs, len(runs), session.scene, session.executor.workers))
    work = _pooled(session, "work", jobs)
    times = _timed(session, rounds, runs, work)
    return timings(_resolved(session.planned), rounds, work, times)


def _pooled(session: SweepSession, purpose: Purpose, jobs: Sequence[Job]) -> dict[str, Note]:
    """Return what workers find in a pass, by run id; nothing of runs that crash a worker."""
    done = noted(session.store.notes(), purpose)
    rest = [job for job in jobs if any(run.run_id not in done for run in job)]
    runs = sum(map(len, jobs))
    session.begin(runs, runs - sum(map(len, rest)))
    task = replace(session.task, purpose=purpose)
    for result in results_of(task, rest, session.executor, session.stop):
        crashed = isinstance(result, Crashed)
        each = [note(purpose, run.run_id, {}) for run in result.job] if crashed else result
        session.store.note([one.row for one in each])
        session.progress(each)
    return noted(session.store.notes(), purpose)


def _timed(
    session: SweepSession, rounds: int, planned: Planned, work: Mapping[str, Note]
) -> dict[str, Note]:
    """Return the times of all runs, which are taken together or not at all."""
    times = noted(session.store.notes(), "times")
    planned = [each for each in planned if work.get(each[0].run_id)]
    runs, backend = _resolved(planned), backend_at(session.task.store, OutputError)
    controls = {
        run.run_id: read_controls(backend, run.controls) for run, _ in planned if run.controls
    }
    left = sum(run_id not in times for run_id in runs)
    session.begin(len(runs), len(runs) - left)
    if not left:
        return times
    timed: list[Finished] = []
    for run_id, each in InterleavedTimer(session.scene, rounds, controls).times(runs, work):
        timed.append(note("times", run_id, each))
        session.progress(timed[-1:])
    session.store.note([each.row for each in timed])
    return noted(session.store.notes(), "times")
