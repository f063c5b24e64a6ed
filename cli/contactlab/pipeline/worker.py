"""Run a job: models, rollouts, metrics, labels, traces, records."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from pydantic_core import to_json

from contactlab.evidence import TRACES, TraceExtras, TraceSummary, to_row, write_trace
from contactlab.pipeline.accuracy_job import errors_of
from contactlab.pipeline.groups import Group, measured_groups
from contactlab.pipeline.job import IMPULSE, Finished, Job, PlannedRun, Task
from contactlab.pipeline.missed import missed_effects
from contactlab.pipeline.preparing import Preparer
from contactlab.pipeline.record import Outcome, RecordMaker, RunPlan
from contactlab.pipeline.timing_job import work_of
from contactlab.scene import Starts, make_setup
from contactlab.schema import EvidenceRecord, LabelEntry, TraceFile
from contactlab.sim import (
    Buffers,
    Rollout,
    make_trace,
    roll_out,
    roll_out_by_impulse,
    run_checks,
    trajectory_hash,
)
from contactlab.trace import Checks, Trace

_RECORD_SCHEMA = b'{"type":"object"}'


class Worker:
    """Runs jobs of one sweep, keeping models and memory between them."""

    def __init__(self, task: Task, marker: Path | None) -> None:
        self._task = task
        self._preparer = Preparer(task, marker)
        self._scene = self._preparer.scene
        self._buffers, self._twin_buffers = Buffers(), Buffers()
        self._folders: set[Path] = set()
        self._records = RecordMaker(task, self._scene.hash)
        model = self._scene.source.model
        self._model_xml = model.read_bytes()

    def run(self, job: Job) -> list[Finished]:
        """Do what the task is for with a job of runs."""
        if self._task.purpose == "errors":
            return errors_of(self._preparer, job)
        if self._task.purpose == "work":
            return work_of(self._preparer, job)
        return self._record(job)

    def _record(self, job: Job) -> list[Finished]:
        """Run a job of runs that share structure and step count; write their traces."""
        started = self._records.now()
        plans = self._preparer.plans(job)
        starts = Starts.joined([plan.start for plan in plans])
        rollout, groups = self._measure(plans, starts, self._buffers)
        labels = self._twin_labels(plans, starts)
        finished: dict[int, Finished] = {}
        for group in groups:
            for row, place in zip(group.rows, group.places, strict=True):
                outcome = Outcome(
                    plan=plans[place],
                    assessment=group.assessment,
                    row=row,
                    steps=rollout.steps[place],
                    warnings=rollout.warnings[place],
                    error=rollout.errors[place],
                    trajectory_hash=trajectory_hash(rollout, place),
                    cpu=float(rollout.cost[place]),
                    started=started,
                    twin_label=labels.get(place),
                )
                finished[place] = self._finish(outcome, group)
        return [finished[place] for place in range(len(job))]

    def _measure(
        self, plans: Sequence[RunPlan], starts: Starts, buffers: Buffers
    ) -> tuple[Rollout, Iterator[Group]]:
        """Simulate runs from the given starts, and measure and label them."""
        resolved = [plan.resolved for plan in plans]
        prepared = [plan.prepared for plan in plans]
        models = [each.model for each in prepared]
        base, steps = self._scene.base_of(resolved[0]), resolved[0].steps
        by_hand = resolved[0].settings["engine"] == IMPULSE
        with self._preparer.watchdog() as watch:
            if by_hand:
                rollout = roll_out_by_impulse(base, prepared, starts, steps, buffers)
            else:
                rollout = roll_out(models, starts, steps, buffers, watch)
        manifest, sweep = self._scene.source.manifest, self._task.sweep
        setup = make_setup(base, manifest, resolved, models, sweep.thresholds)
        trace = make_trace(base, prepared, rollout)

        def check(places: Sequence[int], picked: Trace) -> Checks:
            some = [prepared[place] for place in places]
            return run_checks(base, some, starts.rows(places), picked)

        rule = "none" if by_hand else sweep.checks
        return rollout, measured_groups(trace, setup, rollout, rule, check)

    def _twin_labels(self, plans: Sequence[RunPlan], starts: Starts) -> dict[int, str]:
        """Return the label that each run gets from a start that is hardly another, if asked."""
        if not self._task.sweep.knife_edge:
            return {}
        nudged = self._scene.nudged(starts, [plan.resolved for plan in plans])
        _, groups = self._measure(plans, nudged, self._twin_buffers)
        return {
            place: group.assessment.labels[row][0].label
            for group in groups
            for row, place in zip(group.rows, group.places, strict=True)
        }

    def lost(self, run: PlannedRun, label: LabelEntry) -> Finished:
        """Return the outcome of a run that no worker survives."""
        (plan,) = self._preparer.plans((run,))
        return _finished(self._records.lost(plan, label))

    def _finish(self, outcome: Outcome, group: Group) -> Finished:
        missed = missed_effects(group.trace, outcome.row, outcome.plan.prepared)
        record = self._records.make(outcome).model_copy(update={"effects_missed": missed})
        if self._keeps_trace(outcome.plan.run, record):
            trace = self._write_trace(record, outcome, group)
            record = record.model_copy(update={"trace": trace})
        record = self._records.with_cost(record, outcome)
        return _finished(record)

    def _keeps_trace(self, run: PlannedRun, record: EvidenceRecord) -> bool:
        rule = self._task.sweep.trace
        if rule.startswith("sample:"):
            wanted = int(rule.removeprefix("sample:"))
            return run.index * wanted % self._task.runs < wanted
        return rule == "all" or (rule == "flagged" and record.label != "stable")

    def _write_trace(self, record: EvidenceRecord, outcome: Outcome, group: Group) -> TraceFile:
        """Write a run's trace; its record there has neither cost nor clock, so that it repeats."""
        file = Path(TRACES) / record.run_id[:2] / f"{record.run_id}.mcap"
        path = self._task.store / file
        self._make(path.parent)
        extras = TraceExtras(
            record_json=record.model_dump_json().encode(),
            record_schema=_RECORD_SCHEMA,
            metadata=_metadata(record),
            model_xml=self._model_xml,
        )
        summary: TraceSummary = write_trace(
            path, group.trace, outcome.row, outcome.assessment.series, extras
        )
        return TraceFile(
            file=file.as_posix(),
            sha256=summary.sha256,
            bytes=summary.size,
            messages=dict(summary.messages),
        )

    def _make(self, folder: Path) -> None:
        """Make a folder of traces; to ask the system for one that is there costs as much."""
        if folder not in self._folders:
            folder.mkdir(parents=True, exist_ok=True)
            self._folders.add(folder)


def _finished(record: EvidenceRecord) -> Finished:
    return Finished(
        row=to_json(to_row(record)),
        label=record.label,
        status=record.status,
        expectation_met=record.expectation_met,
    )


def _metadata(record: EvidenceRecord) -> dict[str, str]:
    return {
        "run_id": record.run_id,
        "sweep": record.sweep,
        "scene": record.scene,
        "scene_hash": record.scene_hash,
        "seed": str(record.seed),
        "label": record.label,
        "engine": f"{record.engine.name} {record.engine.version}",
        "contactlab": record.provenance.contactlab,
    }
