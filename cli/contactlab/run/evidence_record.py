"""The evidence record of a run, and its provenance."""

import hashlib
import math
import os
import platform
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.metadata import version
from itertools import groupby
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from pydantic_core import to_json

from contactlab.accuracy.reference import PlannedModel
from contactlab.contact.trace_arrays import PairSeries, RecordedControls, Trace
from contactlab.engines import engine_of
from contactlab.engines.engine import Rollout
from contactlab.engines.rollout_trace import trajectory_hash
from contactlab.measure import METRICS, AppliedLabel, Assessment
from contactlab.plan.grid import find_expectations
from contactlab.plugins import hash_of_packages
from contactlab.resources import ADAPTERS
from contactlab.run.git_commit import commit_of
from contactlab.run.run_verdicts import judge_expectations, missing_effects, within_tolerances
from contactlab.run.tasks import FinishedRun, Task
from contactlab.scene.effects.effect import NOT_IN_MODEL, EffectState
from contactlab.schema.evidence import (
    Cost,
    Engine,
    EvidenceRecord,
    Host,
    LabelEntry,
    Provenance,
)
from contactlab.store.mcap.trace_writer import TraceEncoder
from contactlab.store.store_files import time_now
from contactlab.store.table_layout import axes_as_written, row_entries, to_row

Fields = dict[str, Any]  # fields of a record, by name
_NONE = np.array(None)
# Fields that a record omits if they are empty.
_OMITTED_IF_EMPTY = {
    name for name, field in EvidenceRecord.model_fields.items() if field.exclude_if
}


@cache
def hash_definitions() -> str:
    """Return a hash of the code that prepares runs, rolls them out, measures and labels them."""
    packages = ("accuracy", "contact", "engines", "measure", "scene")
    return hash_of_packages((f"contactlab.{name}" for name in packages), ADAPTERS)


class CommonFields:
    """Fields shared by the records of runs that differ only in their seed.

    Attributes:
        fields: fields of the record, by name.
        expectations: the expectations of the sweep for the runs.
        left_out: the effects that the model has but the runs omit.
    """

    def __init__(self, task: Task, plan: PlannedModel) -> None:
        run, identity = plan.run, task.identity
        self._parts: dict[tuple[str, ...], list[bytes | list[str]]] = {}
        engine = engine_of(run)
        # Effects that its engine ignores are off.
        off = {name: EffectState(False, why) for name, why in engine.ignored(run).items()}
        effects = {name: off.get(name, effect) for name, effect in plan.prepared.effects.items()}
        self.expectations = find_expectations(task.expected, run.axes)
        unused = {name: effect for name, effect in plan.prepared.effects.items() if not effect.on}
        self.left_out = {name for name, effect in unused.items() if effect.reason != NOT_IN_MODEL}
        self.fields: Fields = {
            "sweep": identity.name,
            "scene": identity.scene,
            "scene_hash": identity.scene_hash,
            "engine": Engine(name=engine.name, version=engine.version),
            "axes": axes_as_written(run.axes),
            "settings": run.values,
            "effects": {name: effect.on for name, effect in effects.items()},
            "effect_reasons": {name: effect.reason for name, effect in effects.items()},
            "pairs": dict(plan.prepared.pairs),
            "edited_geoms": plan.prepared.edited_geoms,
            "duration": run.duration,
            "drive": run.drive,
            "steps_asked": run.steps,
            "metric_versions": identity.metric_versions,
            "units": {name: metric.unit for name, metric in METRICS.items()},
            "provenance": task.provenance,
            "plugins": identity.plugins,
        }

    @cached_property
    def entries(self) -> Sequence[bytes]:
        """The entries of a row, as JSON."""
        return row_entries(self.fields)

    def record_json(self, own: Fields) -> bytes:
        """Return a run's record without cost and times of day: equal runs have equal records."""
        labels = [verdict._asdict() for verdict in own["labels"]]
        own = own | {"labels": labels, "initial": vars(own["initial"])}
        names = tuple(
            name
            for name, value in own.items()
            if value is not None or name not in _OMITTED_IF_EMPTY
        )
        if names not in self._parts:
            self._parts[names] = self._record_parts(names)
        parts = self._parts[names]
        # NaN is written as null, as in all records.
        texts = (
            to_json({name: own[name] for name in part}, inf_nan_mode="null")[1:-1]
            if isinstance(part, list)
            else part
            for part in parts
        )
        return b"{%b}" % b",".join(texts)

    def _record_parts(self, own: Collection[str]) -> list[bytes | list[str]]:
        """Return a record in its order: common fields as JSON, a run's own fields by name."""
        common = EvidenceRecord.model_construct(None, **self.fields)
        parts: list[bytes | list[str]] = []
        for is_own, names in groupby(EvidenceRecord.model_fields, own.__contains__):
            if is_own:
                parts.append([*names])
            elif text := common.model_dump_json(include={*names})[1:-1]:
                parts.append(text.encode())
        return parts


def common_fields_of(task: Task, plans: Iterable[PlannedModel]) -> Iterator[CommonFields]:
    """Yield the common fields of each run; neighboring runs may share one object."""
    common: CommonFields | None = None
    last: PlannedModel | None = None
    for plan in plans:
        alike = last and plan.prepared is last.prepared and plan.run.is_sibling(last.run)
        if common is None or not alike:
            common, last = CommonFields(task, plan), plan
        yield common


RunRow = tuple[Fields, CommonFields]
"""A run's row: the fields of its own, and the fields in common with others."""


@dataclass(frozen=True)
class MeasuredGroup:
    """Runs that were measured together; `rows` maps indices in the job to rows of the arrays."""

    rows: Mapping[int, int]
    trace: Trace
    assessment: Assessment

    @cached_property
    def metrics(self) -> list[dict[str, float | None]]:
        """The metrics of each row, None if they do not apply."""
        metric_values = self.assessment.metrics
        columns = [
            np.where(np.isfinite(values), values, _NONE).tolist()
            for values in metric_values.values()
        ]
        return [dict(zip(metric_values, row, strict=True)) for row in zip(*columns, strict=True)]

    @cached_property
    def encoder(self) -> TraceEncoder:
        """Encoders of the traces of rows."""
        pairs, net = self.assessment.pairs, self.assessment.pairs.net.series
        arrays = [each for name, each in vars(net).items() if name != "name"]
        touching = np.flatnonzero(net.contacts.any(axis=(1, 2))).tolist()
        series = [
            PairSeries(pairs.names[pairs.places[row]], *(each[row] for each in arrays))
            for row in touching
        ]
        return TraceEncoder(self.trace, series)


@dataclass(frozen=True)
class RunOutcome:
    """The results of one run: a row of its group, at an index in the rollout of its job.

    The twin label is that of the same run from an initial state 1e-6 away, if the sweep requests
    it.
    """

    plan: PlannedModel
    common: CommonFields
    group: MeasuredGroup
    rollout: Rollout
    place: int
    started: str
    twin_label: str | None

    @property
    def row(self) -> int:
        """Its row in the arrays of its group."""
        return self.group.rows[self.place]

    @property
    def steps(self) -> int:
        """Number of steps made."""
        return self.rollout.steps[self.place]

    @property
    def controls(self) -> RecordedControls | None:
        """Controls applied to it: those of its policy, or of its task.

        None if that failed, and for scenes and files that define the controls themselves.
        """
        if self.rollout.controls:
            return self.rollout.controls[self.place]
        run, scene = self.plan.run, self.plan.start
        is_computed = run.drive == "exercise" or (
            run.drive == "none" and not scene.driven_inputs.size
        )
        return scene.recorded_inputs_until(run.steps * run.timestep) if is_computed else None


def own_fields(task: Task, outcome: RunOutcome) -> Fields:
    """Return the fields of a run's own in its record, without cost and times of day."""
    common, group, row, place = outcome.common, outcome.group, outcome.row, outcome.place
    labels, coverage = group.assessment.labels[row], group.assessment.coverage
    bodies = group.assessment.backward_error_body
    twin, error = outcome.twin_label, outcome.rollout.errors[place]
    invalid = () if error is None else (AppliedLabel("invalid", error, 0),)
    if (error := outcome.rollout.errors[outcome.place]) is not None:
        status, reason = "error", error
    elif outcome.steps == outcome.plan.run.steps:
        status, reason = "ok", None
    else:
        warnings = ", ".join(outcome.rollout.warnings[outcome.place]) or "no warning"
        status, reason = "stopped", f"the engine stopped after {outcome.steps} steps: {warnings}"
    model = outcome.plan.prepared.model
    return {
        **_common_outcome_fields(
            task, outcome.plan, common, group.metrics[row], (*invalid, *labels)
        ),
        "status": status,
        "status_reason": reason,
        "steps": outcome.steps,
        "warnings": dict(outcome.rollout.warnings[place]),
        "effects_missed": missing_effects(group.trace, row, common.left_out, model),
        "trajectory_hash": trajectory_hash(outcome.rollout, place),
        "knife_edge": None if twin is None else twin != labels[0].label,
        "coverage": coverage and coverage[row],
        "backward_error_body": bodies and bodies[row],
    }


def row_of_crash(task: Task, plan: PlannedModel, label: LabelEntry) -> RunRow:
    """Return the row of a run with a worker that died twice: `crashed` or `timeout`."""
    common = CommonFields(task, plan)
    own = _common_outcome_fields(task, plan, common, dict.fromkeys(METRICS), (label,))
    own |= {"status": label.label, "status_reason": label.reason}
    return own | {"steps": 0, "warnings": {}, "effects_missed": {}}, common


def _common_outcome_fields(
    task: Task,
    plan: PlannedModel,
    common: CommonFields,
    metrics: dict[str, float | None],
    labels: Sequence[AppliedLabel | LabelEntry],
) -> Fields:
    names, run = [entry.label for entry in labels], plan.run
    expected, is_met, reason = judge_expectations(common.expectations, names, metrics)
    applied = plan.start.applied if plan.start.applied.any() else plan.start.applied[:, :0]
    parts = {
        "qpos": plan.start.qpos,
        "qvel": plan.start.qvel,
        "ctrl": plan.start.ctrl,
        "applied": applied,
    }
    return {
        "run_id": run.run_id,
        "index": run.index,
        "seed": run.seed,
        "initial": SimpleNamespace(
            **{name: tuple(part[0].tolist()) for name, part in parts.items()}
        ),
        "metrics": metrics,
        "label": names[0],
        "labels": labels,
        "expected": expected,
        "expectation_met": is_met,
        "expectation_reason": reason,
        "tolerances_met": within_tolerances(task.sweep.tolerances, metrics),
    }


def journal_entries(rows: Sequence[RunRow]) -> list[FinishedRun]:
    """Return runs as journal entries: fields shared by all of their rows are written once."""
    entries = {common: common.entries for _, common in rows}
    shared = set.intersection(*map(set, entries.values())) if len(rows) > 1 else set[bytes]()
    rest = {
        common: [entry for entry in own if entry not in shared] for common, own in entries.items()
    }
    shared_text = b"{%b}" % b",".join(sorted(shared)) if shared else b""
    finished: list[FinishedRun] = []
    for own, common in rows:
        row = {name: value for name, value in to_row(own).items() if value is not None}
        text = b",".join([to_json(row)[:-1], *rest[common]]) + b"}"
        finished.append(
            FinishedRun(text, own["label"], own["status"], own["expectation_met"], shared_text)
        )
    return finished


def cost_and_times(task: Task, outcome: RunOutcome) -> Fields:
    """Return the cost and times of day in the record of a run that just ended."""
    cpu, timestep = float(outcome.rollout.cost[outcome.place]), outcome.plan.run.timestep
    step_times = (
        None if math.isnan(cpu) else (cpu, outcome.steps, timestep, task.sweep.latency_budget)
    )
    return {
        "started": outcome.started,
        "finished": time_now(),
        "cost": step_times and Cost.of_steps(*step_times),
    }


@cache
def find_engine() -> Engine:
    """Return the engine and its version, without loading it."""
    return Engine(name="mujoco", version=version("mujoco"))


def find_provenance() -> Provenance:
    """Return versions and machine, with the commit of the current folder."""
    try:
        revision = commit_of(Path.cwd())
    except OSError:
        revision = None
    # Entries of the first processor in /proc/cpuinfo; none without such a file.
    file = Path("/proc/cpuinfo")
    first = file.read_text(encoding="utf-8").split("\n\n")[0] if file.is_file() else ""
    pairs = (line.partition(":") for line in first.splitlines())
    info = {name.strip(): value.strip() for name, _, value in pairs}
    flags = " ".join(sorted(info.get("flags", "").split()))
    return Provenance(
        contactlab=version("contactlab"),
        git_revision=revision,
        python=platform.python_version(),
        numpy=np.__version__,
        host=Host(
            # The first of the others starts a process to find out.
            cpu_model=info.get("model name") or platform.processor() or platform.machine(),
            cpu_flags=hashlib.sha256(flags.encode()).hexdigest()[:16],
            cores=os.cpu_count() or 1,
            os=f"{platform.system()} {platform.release()}",
        ),
    )
