"""Passes over a sweep's runs after all are recorded: errors, work and times."""

import math
import sys
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from statistics import fmean
from typing import Any

from contactlab.accuracy.discretization import Note, reference_families, run_accuracies
from contactlab.accuracy.timing import Groups, InterleavedTimer, run_timings
from contactlab.engines import engine_of
from contactlab.engines.engine import SimulationEngine, SolvesReferences, TimesSteps
from contactlab.errors import OutputError
from contactlab.pareto.criteria import MODELING_ERROR, find_error_metric
from contactlab.run.planned_runs import RunIndex, pack_jobs, reference_models
from contactlab.run.run_verdicts import within_tolerances
from contactlab.run.tasks import (
    BeginCallback,
    CrashedJob,
    Executor,
    Job,
    ProgressCallback,
    Purpose,
    Stop,
    Task,
    note_result,
    notes_by_run,
    results_of,
)
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene
from contactlab.schema.drive import PolicyDrive
from contactlab.schema.evidence import ERRORS, Accuracy, Timing
from contactlab.schema.sweep_schema import TimingRequest
from contactlab.step_progress import step_names
from contactlab.store.controls_file import read_controls
from contactlab.store.folder_backend import backend_at
from contactlab.store.store_writer import StoreWriter
from contactlab.store.table_layout import Column, as_ratios

Row = Mapping[str, Any]
_TIMES = "times"
# Names of the passes over finished runs.
_PHASES: Mapping[Purpose, str] = {"errors": "errors", "work": "counts of work"}


@dataclass(frozen=True)
class SweepSession:
    """A running sweep with its store, executor and callbacks."""

    task: Task
    scene: Scene
    store: StoreWriter
    index: RunIndex
    executor: Executor
    stop: Stop
    begin: BeginCallback
    progress: ProgressCallback

    @cached_property
    def outcomes(self) -> dict[str, Row]:
        """Results of rows that later passes need, by run id, without errors."""
        tolerances = self.task.sweep.tolerances.keys() - set(ERRORS)
        names = ("status", "label", "controls", MODELING_ERROR, *tolerances)
        return {
            row["run_id"]: {name: row.get(name) for name in names} for row in self.store.read_rows()
        }

    @cached_property
    def planned_runs(self) -> list[RunSpec]:
        """All of its runs at once; only small sweeps have passes."""
        return list(self.index.iterate_runs())

    def repeatable_runs(self, able: Callable[[SimulationEngine], bool]) -> list[RunSpec]:
        """Return the completed runs with an engine that is able; only these are repeated."""
        return [
            replace(run, controls=row["controls"]) if isinstance(run.drive, PolicyDrive) else run
            for run in self.planned_runs
            if (row := self.outcomes[run.run_id])["status"] == "ok" and able(engine_of(run))
        ]


def run_passes(session: SweepSession) -> tuple[dict[str, dict[str, Any]], Sequence[Column]]:
    """Compute the requested errors, work and times of the sweep, by run id and column.

    Results noted before an interruption are not computed again. Columns with an unusual unit are
    returned, too.
    """
    values: dict[str, dict[str, Any]] = {}
    columns: Sequence[Column] = ()
    sweep = session.task.sweep
    if sweep.accuracy is not None:
        repeatable = session.repeatable_runs(lambda engine: isinstance(engine, SolvesReferences))
        runs = {run.run_id: run for run in repeatable}
        controls = {run_id: run.controls for run_id, run in runs.items()}
        with step_names(1) as begin_step:
            begin_step("preparing references")
            models = reference_models(session.scene, session.task.sweep, repeatable)
            grouped = reference_families(models, session.scene, controls)
        notes = results_of_pass(
            session, "errors", [tuple(map(runs.__getitem__, rows)) for rows in grouped]
        )
        errors = run_accuracies(sweep.accuracy, session.scene, _by_id(session.planned_runs), notes)
        values = {run_id: _accuracy_row(session, run_id, error) for run_id, error in errors.items()}
        if any(error.error_kind == "invariants" for error in errors.values()):
            columns = as_ratios(name for name in Accuracy.model_fields if name.startswith("error_"))
    if sweep.timing is not None:
        for run_id, timing in _measure_times(session, sweep.timing, values).items():
            values[run_id] = values.get(run_id, {}) | timing.model_dump()
    return values, columns


def _by_id(runs: Iterable[RunSpec]) -> dict[str, RunSpec]:
    return {run.run_id: run for run in runs}


def _accuracy_row(session: SweepSession, run_id: str, accuracy: Accuracy) -> dict[str, Any]:
    """Return the columns of a run's accuracy, and whether it still meets every tolerance."""
    row = accuracy.model_dump()
    metrics = {**session.outcomes[run_id], **{name: row[name] for name in ERRORS}}
    return {**row, "tolerances_met": within_tolerances(session.task.sweep.tolerances, metrics)}


def _measure_times(
    session: SweepSession, request: TimingRequest, errors: Mapping[str, Row]
) -> dict[str, Timing]:
    able = session.repeatable_runs(lambda engine: isinstance(engine, TimesSteps))
    # Seeds share the cost of a step, up to the noise between two rounds; scenarios do not.
    keys = {run.run_id: _axes_key(run) if request.contenders else run.run_id for run in able}
    firsts = {keys[run.run_id]: run.run_id for run in reversed(able)}
    timed_ids = set(firsts.values())
    timed_runs = [run for run in able if run.run_id in timed_ids]
    jobs = list(pack_jobs(timed_runs, len(timed_runs), session.scene, session.executor.workers))
    work = results_of_pass(session, "work", jobs)

    # All runs are timed together, or none again.
    timed_runs = [run for run in timed_runs if work.get(run.run_id)]
    runs, turns = _by_id(timed_runs), request.rounds * len(timed_runs)
    stored_times = notes_by_run(session.store.read_notes(), "times")
    if runs.keys() <= stored_times.keys():
        session.begin(turns, turns, _TIMES)
    else:
        session.begin(turns, 0, _TIMES)
        backend = backend_at(session.task.store, OutputError)
        controls = {
            run.run_id: read_controls(backend, run.controls) for run in timed_runs if run.controls
        }
        groups, select = [(run_id,) for run_id in runs], lambda _: groups
        if request.contenders:
            select = _Contenders(session, timed_runs, errors)
            groups = select.groups
        turn = note_result("times", "", {})
        timer = InterleavedTimer(session.scene, request.rounds, controls)
        samples_by_run = timer.time_runs(
            runs, work, groups, select, lambda count: session.progress([turn] * count)
        )
        session.store.write_notes(
            [note_result("times", run_id, samples).row for run_id, samples in samples_by_run]
        )
        stored_times = notes_by_run(session.store.read_notes(), "times")
    times = {
        run_id: stored_times[firsts[key]]
        for run_id, key in keys.items()
        if firsts[key] in stored_times
    }
    return run_timings(_by_id(session.planned_runs), request, work, times)


def _axes_key(run: RunSpec, but: Collection[str] = ()) -> object:
    """Return the values of a run's axes without some axes, as a key."""
    return tuple(item for item in run.axes.items() if item[0] not in but)


def results_of_pass(
    session: SweepSession, purpose: Purpose, jobs: Sequence[Job]
) -> dict[str, Note]:
    """Return the results of workers in a pass, by run id; empty for runs that crash a worker.

    Results from before an interruption are among them.
    """
    notes = notes_by_run(session.store.read_notes(), purpose)
    rest = [job for job in jobs if any(run.run_id not in notes for run in job)]
    runs = sum(map(len, jobs))
    session.begin(runs, runs - sum(map(len, rest)), _PHASES.get(purpose, ""))
    task = replace(session.task, purpose=purpose)
    for result in results_of(task, rest, session.executor, session.stop):
        crashed = isinstance(result, CrashedJob)
        each = [note_result(purpose, run.run_id, {}) for run in result.job] if crashed else result
        session.store.write_notes([one.row for one in each])
        session.progress(each)
    return notes_by_run(session.store.read_notes(), purpose)


class _Contenders:
    """Selects configurations that may be recommended, like `contactlab.pareto`, from the times.

    They have no failed run and no missed tolerance; without any such, all count. One stays unless
    another is no less accurate, has no smaller margin and is clearly faster.
    """

    def __init__(
        self, session: SweepSession, timed_runs: Sequence[RunSpec], errors: Mapping[str, Row]
    ) -> None:
        sweep, limits = session.task.sweep, session.task.sweep.tolerances
        name = find_error_metric(limits) or (ERRORS[0] if sweep.accuracy else MODELING_ERROR)
        every, own = defaultdict[object, list[str]](list), defaultdict[object, list[str]](list)
        for runs, groups_of_axes in ((session.planned_runs, every), (timed_runs, own)):
            for run in runs:
                groups_of_axes[_axes_key(run, sweep.scenario)].append(run.run_id)
        # Each group with its error, and the largest share of a tolerance that it uses.
        paces: list[tuple[Sequence[str], float, float]] = []
        for key, group in own.items():
            rows = [{**session.outcomes[run_id], **errors.get(run_id, {})} for run_id in every[key]]
            failed = math.inf if any(row["label"] != "stable" for row in rows) else 0.0
            budget_shares = [
                _share_of_limit(row.get(limited), limit)
                for limited, limit in limits.items()
                for row in rows
            ]
            error = max(_share_of_limit(row.get(name), 1.0) for row in rows)
            paces.append((group, error, max([failed, *budget_shares])))
        self.groups: Groups = [group for group, *_ in paces]
        self._known = [pace for pace in paces if pace[2] <= 1] or paces

    def __call__(self, times: Mapping[str, float]) -> Groups:
        costs = [fmean(times[run_id] for run_id in group) for group, *_ in self._known]
        ranked = list(zip(self._known, costs, strict=True))
        # Further rounds do not change the order of times with a larger ratio.
        clear_time_ratio = 1.25
        return [
            group
            for (group, error, budget_share), cost in ranked
            if not any(
                clear_time_ratio * least < cost and other <= error and part <= budget_share
                for (_, other, part), least in ranked
            )
        ]


def _share_of_limit(value: float | None, limit: float) -> float:
    """Return a value as a share of a limit, infinite if it could not be measured."""
    return math.inf if value is None else abs(value) / max(limit, sys.float_info.min)
