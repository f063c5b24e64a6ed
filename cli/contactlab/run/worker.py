"""Runs jobs: rolls runs out, measures and labels them, writes traces and records."""

import hashlib
import os
import time
from collections.abc import Hashable, Iterator, Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from contactlab.accuracy.discretization import discretization_errors
from contactlab.accuracy.reference import PlannedModel
from contactlab.accuracy.timing import work_of_runs
from contactlab.budget import backward_error
from contactlab.budget.backward_error import whole_verdict
from contactlab.contact.trace_arrays import SelfChecks, Trace
from contactlab.contact.trace_setup import Setup
from contactlab.disk_arrays import arrays_on_disk
from contactlab.engines import engine_of
from contactlab.engines.closed_loop import load_policy
from contactlab.engines.engine import (
    Buffers,
    ChecksRuns,
    PreparedRuns,
    Proceed,
    Rollout,
    Watch,
    bytes_of_run,
    no_limit,
    proceed_always,
)
from contactlab.engines.rollout_trace import make_trace
from contactlab.errors import OutputError
from contactlab.measure import Assessment, assess_runs
from contactlab.plan.kept_traces import KeptTraces
from contactlab.plugins import require_plugins
from contactlab.registry import fill_registry
from contactlab.run.evidence_record import (
    CommonFields,
    MeasuredGroup,
    RunOutcome,
    RunRow,
    common_fields_of,
    cost_and_times,
    journal_entries,
    own_fields,
    row_of_crash,
)
from contactlab.run.planned_runs import JOB_BYTES, LONG_BYTES, Preparer, reference_models
from contactlab.run.tasks import FinishedRun, Job, Task, note_result
from contactlab.scene.initial_states import InitialStates
from contactlab.scene.model_names import input_names
from contactlab.scene.requirements import RunRequirement
from contactlab.scene.run_setup import make_setup, measurement_key
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene_source import BINARY
from contactlab.schema.evidence import LabelEntry, TraceFile
from contactlab.store.backend import Backend
from contactlab.store.controls_file import controls_name, encode_controls
from contactlab.store.folder_backend import backend_at
from contactlab.store.mcap.encode_buffers import SCRATCH
from contactlab.store.mcap.trace_reader import ACTIVATIONS
from contactlab.store.store_files import TRACES, time_now

ExtraFields = Mapping[str, object]  # fields of a record that its run does not decide
_GRACE_SECONDS = 1.0  # time that a job's second pass may continue after a stop request [s]
# Time limit of a second pass in limits of a run: it makes six times the steps, more accurately.
_SECOND_PASS_LIMITS = 10


def _trace_name(run_id: str) -> str:
    return f"{TRACES}/{run_id[:2]}/{run_id}.mcap"


class _AbandonedError(Exception):
    """A pass over runs was abandoned, because the sweep should stop."""


class Worker:
    """Runs jobs of one sweep, keeping models and memory between them.

    Raises a PluginError if a plug-in of the sweep is not here; an OutputError if its store cannot
    be reached or written.
    """

    def __init__(self, task: Task, marker: Path | None, proceed: Proceed = proceed_always) -> None:
        fill_registry(*task.fillers)
        require_plugins(task.plugins)
        self._task = task
        self._proceed = proceed
        self._preparer = Preparer(task, marker)
        self.scene = self._preparer.scene
        self._buffers, self._twin_buffers = Buffers(JOB_BYTES), Buffers(JOB_BYTES)
        self._store = backend_at(task.store, OutputError)
        self._traces = KeptTraces.read_rule(task.sweep.trace)
        self._controls: set[str] = set()  # hashes of the controls that this process has stored
        self._policy = task.policy and load_policy(task.policy.with_fallback(self.scene.drive))
        self._player = task.environment and task.environment.player(self.scene, self._policy)
        source = self.scene.source
        self._model_xml = b"" if source.model.suffix == BINARY else source.model.read_bytes()

    def run(self, job: Job) -> list[FinishedRun]:
        """Perform the task's purpose on the runs of a job, or on some of them if it should stop."""
        process, finished = os.getpid(), list[FinishedRun]()
        if not self._proceed():
            return finished
        size = bytes_of_run(self.scene.base_of(job[0]).model, job[0].steps)
        with arrays_on_disk() if size > LONG_BYTES else nullcontext():
            if self._task.purpose == "record":
                finished = self._play_episodes(job) if self._player else self._record_job(job)
            elif self._task.purpose == "outcomes":
                finished = self._play_outcomes(job)
            else:
                with suppress(_AbandonedError):
                    finished = self._run_pass(job)
        if size > LONG_BYTES:
            SCRATCH.drop_buffers()
            self._buffers, self._twin_buffers = Buffers(JOB_BYTES), Buffers(JOB_BYTES)
        if os.getpid() != process:
            # A plug-in has forked this process, and its copy would return the results twice.
            os._exit(0)
        return finished

    def _run_pass(self, job: Job) -> list[FinishedRun]:
        """Return a note for each run of a job: its work, or the errors of a family."""
        plans, request = self._preparer.plan_job(job), self._task.sweep.accuracy
        purpose = self._task.purpose

        def watch() -> None:
            if not self._proceed():
                raise _AbandonedError
            start_clock()

        with self._preparer.start_watchdog() as start_clock:
            if purpose == "errors" and request is not None:
                (model,) = reference_models(self.scene, self._task.sweep, job[:1]).values()
                pass_results = discretization_errors(self.scene, plans, model, request, watch)
            else:
                pass_results = list(work_of_runs(self.scene, plans, watch))
        return [
            note_result(purpose, run.run_id, numbers)
            for run, numbers in zip(job, pass_results, strict=True)
        ]

    def _record_job(self, job: Job) -> list[FinishedRun]:
        """Run a job of runs that share structure and step count, and write their traces.

        Runs of one kind are processed together, so that no run depends on its neighbors, and as
        many at a time as fit into memory.
        """
        plans = self._preparer.plan_job(job)
        kinds = dict[Hashable, list[int]]()
        for place, plan in enumerate(plans):
            kinds.setdefault(measurement_key(plan.run, plan.prepared.model), []).append(place)
        rows = dict[int, RunRow]()
        for places in kinds.values():
            remaining_places = places
            while remaining_places and (not rows or self._proceed()):
                alike = self._record_alike([plans[place] for place in remaining_places])
                rows |= {remaining_places[row]: encoded for row, encoded in alike.items()}
                remaining_places = [place for place in remaining_places if place not in rows]
        return journal_entries([rows[place] for place in sorted(rows)])

    def _record_alike(self, plans: Sequence[PlannedModel]) -> dict[int, RunRow]:
        """Return the rows of those runs of one kind that were run, at least the first, by index."""
        started = time_now()
        starts = InitialStates.concatenate([plan.start for plan in plans])
        rollout, groups = self._roll_out_and_measure(plans, starts, self._buffers, self._proceed)
        labels = self._twin_labels(plans[: len(rollout.steps)], starts)
        rows = dict[int, RunRow]()
        commons = list(common_fields_of(self._task, plans[: len(rollout.steps)]))
        for group in groups:
            for place in group.rows:
                twin, common = labels.get(place), commons[place]
                if twin is not None or not self._task.sweep.knife_edge:
                    outcome = RunOutcome(plans[place], common, group, rollout, place, started, twin)
                    rows[place] = self._finish_run(outcome)
        return rows

    def _play_episodes(self, job: Job) -> list[FinishedRun]:
        """Let an environment play the episodes of a job, one after the other."""
        finished: list[FinishedRun] = []
        for plan in self._preparer.plan_job(job):
            if not finished or self._proceed():
                with self._preparer.start_watchdog() as start_clock:
                    start_clock()
                    episode = self._player.play(plan)
                finished.append(self.finish_loop(*episode))
        return finished

    def _play_outcomes(self, job: Job) -> list[FinishedRun]:
        finished: list[FinishedRun] = []
        for plan in self._preparer.plan_job(job):
            if not finished or self._proceed():
                with self._preparer.start_watchdog() as start_clock:
                    start_clock()
                    ended = self._player.play_outcome(plan)
                finished.append(note_result("outcomes", plan.run.run_id, ended))
        return finished

    def _roll_out_and_measure(
        self,
        plans: Sequence[PlannedModel],
        starts: InitialStates,
        buffers: Buffers,
        proceed: Proceed,
    ) -> tuple[Rollout, Iterator[MeasuredGroup]]:
        """Roll out, measure and label runs; fewer of them if it should stop."""
        resolved = [plan.run for plan in plans]
        prepared = [plan.prepared for plan in plans]
        runs = PreparedRuns(self.scene, resolved, prepared, starts, resolved[0].steps, self._policy)
        engine = engine_of(resolved[0])
        with self._preparer.start_watchdog() as watch:
            rollout = engine.roll_out(runs, buffers, watch, proceed)
        trace, setup = self._trace_and_setup(runs, rollout)
        return rollout, self._measured_groups(runs, rollout, trace, setup)

    def _trace_and_setup(self, runs: PreparedRuns, rollout: Rollout) -> tuple[Trace, Setup]:
        done_runs = len(rollout.steps)
        resolved, models = runs.resolved[:done_runs], runs.models[:done_runs]
        manifest, sweep = self.scene.source.manifest, self._task.sweep
        run_requirements: list[RunRequirement] = [(text, [True] * done_runs) for text in sweep.must]
        for match, expectation in self._task.expected:
            where = [match.is_met(run.axes) for run in resolved] if expectation.must else []
            run_requirements += [(text, where) for text in expectation.must]
        setup = make_setup(
            runs.base, manifest, resolved, models, sweep.thresholds, run_requirements
        )
        setup = replace(setup, recorded=self.scene.recorded_motion(resolved))
        trace = make_trace(runs.base, runs.prepared[:done_runs], rollout)
        # The momenta of runs with gravity are not measured.
        falling = np.asarray(setup.gravity.any(axis=1))[:, None, None]
        if trace.momentum is not None and trace.angular_momentum is not None and falling.any():
            trace = replace(
                trace,
                momentum=np.where(falling, np.nan, trace.momentum),
                angular_momentum=np.where(falling, np.nan, trace.angular_momentum),
            )
        return trace, setup

    def finish_loop(
        self,
        plan: PlannedModel,
        rollout: Rollout,
        setup_fields: ExtraFields,
        started: str,
        row_fields: ExtraFields,
    ) -> FinishedRun:
        """Store a run of a user's loop, from parts of its setup and fields of its record."""
        runs = PreparedRuns(self.scene, [plan.run], [plan.prepared], plan.start, plan.run.steps)
        trace, setup = self._trace_and_setup(runs, rollout)
        setup = replace(setup, **setup_fields)
        if setup.hold:  # The duration of the run is known only now.
            ends = np.minimum(setup.hold.stop, setup.duration)
            setup = replace(setup, hold=replace(setup.hold, stop=ends))
        (group,) = self._measured_groups(runs, rollout, trace, setup)
        common = CommonFields(self._task, plan)
        row = self._finish_run(
            RunOutcome(plan, common, group, rollout, 0, started, None), row_fields
        )
        return journal_entries([row])[0]

    def _measured_groups(
        self, runs: PreparedRuns, rollout: Rollout, trace: Trace, setup: Setup
    ) -> Iterator[MeasuredGroup]:
        """Measure and label every run: complete ones together, shortened ones one by one."""
        whole = [place for place, steps in enumerate(rollout.steps) if steps == trace.steps_asked]
        if whole:
            yield from self._checked_groups(
                whole, runs, rollout, trace.select(whole), setup.select(whole)
            )
        for place in sorted(set(range(trace.runs)) - set(whole)):
            cut, alone = trace.select([place], rollout.steps[place]), setup.select([place])
            yield MeasuredGroup({place: 0}, cut, self._assess_runs(cut, alone))

    def _assess_runs(
        self, trace: Trace, setup: Setup, checks: SelfChecks | None = None
    ) -> Assessment:
        # Plug-ins measure, too, and get the time that the runs themselves may take.
        with self._preparer.start_watchdog(trace.runs) as start_clock:
            start_clock()
            return assess_runs(trace, setup, checks)

    def _checked_groups(
        self,
        whole: Sequence[int],
        runs: PreparedRuns,
        rollout: Rollout,
        trace: Trace,
        setup: Setup,
    ) -> Iterator[MeasuredGroup]:
        """Yield complete runs; those that the sweep's rule selects are measured again with checks.

        Some of the latter are missing if the second pass is cut short.
        """
        rule, suspects = self._task.sweep.checks, list(range(trace.runs))
        engine = engine_of(runs.resolved[0])
        able = isinstance(engine, ChecksRuns)
        if not (able and rule in ("all", "verdict")):
            assessment = self._assess_runs(trace, setup)
            suspects = [row for row in suspects if rule == "flagged" and assessment.suspect[row]]
            suspects = suspects if able else []
            others = sorted(set(range(trace.runs)) - set(suspects))
            yield MeasuredGroup({whole[row]: row for row in others}, trace, assessment)
        if suspects and able:
            picked_trace, chosen = trace.select(suspects), [whole[row] for row in suspects]
            controls = rollout.controls and [rollout.controls[row] for row in chosen]
            again = runs.rows(chosen).with_recorded_controls(controls)
            with self._preparer.start_watchdog(_SECOND_PASS_LIMITS) as start_clock:
                start_clock()
                proceed = self._grace_period(start_clock)
                judge = whole_verdict if rule == "verdict" else backward_error
                checks = engine.check_runs(again, picked_trace, proceed, judge)
            checked_rows = range(checks.runs)
            checked, checked_setup = (
                picked_trace.select(checked_rows),
                setup.select([suspects[row] for row in checked_rows]),
            )
            second = self._assess_runs(checked, checked_setup, checks)
            yield MeasuredGroup(
                {whole[suspects[row]]: row for row in checked_rows}, checked, second
            )

    def _twin_labels(self, plans: Sequence[PlannedModel], starts: InitialStates) -> dict[int, str]:
        """Return each run's label from an initial state 1e-6 away, if the sweep requests it."""
        if not self._task.sweep.knife_edge:
            return {}
        resolved = [plan.run for plan in plans]
        nudged = self.scene.nudged_states(starts.select_runs(range(len(plans))), resolved)
        _, groups = self._roll_out_and_measure(
            plans, nudged, self._twin_buffers, self._grace_period()
        )
        return {
            place: group.assessment.labels[row][0].label
            for group in groups
            for place, row in group.rows.items()
        }

    def _grace_period(self, watch: Watch = no_limit) -> Proceed:
        """Return the function that lets a second pass continue briefly, run by run."""
        end = time.monotonic() + _GRACE_SECONDS

        def proceed() -> bool:
            watch()
            return time.monotonic() < end or self._proceed()

        return proceed

    @property
    def store_folder(self) -> Path:
        """The folder of its store, on this machine."""
        assert isinstance(self._task.store, Path)
        return self._task.store

    def keep_controls(self, sha256: str, source: Backend) -> None:
        """Copy recorded controls of another store, for a run that names them."""
        if sha256 not in self._controls:
            name = controls_name(sha256)
            self._store.put_file(name, source.read_file(name) or b"")
            self._controls.add(sha256)

    def record_crash(self, run: RunSpec, label: LabelEntry) -> FinishedRun:
        """Record a run that crashes every worker; it has no trace."""
        self._store.delete_files([_trace_name(run.run_id)])
        (plan,) = self._preparer.plan_job((run,))
        return journal_entries([row_of_crash(self._task, plan, label)])[0]

    def _finish_run(self, outcome: RunOutcome, row_fields: ExtraFields | None = None) -> RunRow:
        plan, common = outcome.plan, outcome.common
        own = own_fields(self._task, outcome)
        for name, value in (row_fields or {}).items():
            (common.fields if name in common.fields else own)[name] = value
        if outcome.controls is not None:
            # Controls that are stored already are not stored again.
            sha256 = outcome.controls.sha256
            if sha256 not in self._controls:
                names = input_names(plan.prepared.model, outcome.controls.places)
                self._store.put_file(
                    controls_name(sha256), encode_controls(outcome.controls, names)
                )
                self._controls.add(sha256)
            own["controls"] = sha256
        identity = self._task.identity
        # Indices are those in the whole grid, even for a shard.
        runs = identity.whole.runs if identity.whole else identity.runs_asked
        if self._traces.keeps_trace(plan.run.index, own["label"], runs):
            # The trace's record omits cost and times of day, so it is reproducible.
            name, engine = _trace_name(own["run_id"]), engine_of(plan.run)
            metadata = {
                "run_id": plan.run.run_id,
                "sweep": identity.name,
                "scene": identity.scene,
                "scene_hash": identity.scene_hash,
                "seed": str(plan.run.seed),
                "label": own["label"],
                "engine": f"{engine.name} {engine.version}",
                "contactlab": self._task.provenance.contactlab,
                ACTIVATIONS: str(plan.prepared.model.na),
            }
            record, form = common.record_json(own), self._task.sweep.trace_format
            content, messages = outcome.group.encoder.encode_run(
                outcome.row, record, metadata, self._model_xml, form=form
            )
            self._store.put_file(name, content)
            sha256 = hashlib.sha256(content).hexdigest()
            own["trace"] = TraceFile(
                file=name, sha256=sha256, bytes=len(content), messages=dict(messages)
            )
        return own | cost_and_times(self._task, outcome), common
