"""The evidence record of a run, and the provenance that it states."""

import hashlib
import math
import os
import platform
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from contactlab.accuracy.reference import PlannedModel
from contactlab.contact.trace_arrays import RecordedControls, Trace
from contactlab.engines import engine_of
from contactlab.engines.engine import Rollout
from contactlab.engines.rollout_trace import trajectory_hash
from contactlab.measure import METRICS, Assessment
from contactlab.plugins import hash_of_packages
from contactlab.run.run_verdicts import judge, within_tolerances
from contactlab.run.tasks import PlannedRun, Task
from contactlab.scene.effects.effect import EffectState
from contactlab.scene.initial_states import InitialStates
from contactlab.schema.evidence import (
    Cost,
    Engine,
    EvidenceRecord,
    Host,
    InitialState,
    LabelEntry,
    Provenance,
)
from contactlab.store.store_files import time_now

_NONE = np.array(None)


@cache
def definitions() -> str:
    """Return a hash of the code that prepares runs, rolls them out, measures and labels them."""
    packages = ("accuracy", "contact", "engines", "measure", "scene")
    return hash_of_packages(f"contactlab.{name}" for name in packages)


@dataclass(frozen=True)
class RunPlan(PlannedModel):
    """All that determines one run."""

    run: PlannedRun


@dataclass(frozen=True)
class MeasuredGroup:
    """Runs that were measured together; their rows in trace and assessment by place in the job."""

    rows: Mapping[int, int]
    trace: Trace
    assessment: Assessment

    @cached_property
    def metrics(self) -> list[dict[str, float | None]]:
        """The metrics of each row, None where they do not apply."""
        found = self.assessment.metrics
        columns = [np.where(np.isfinite(each), each, _NONE).tolist() for each in found.values()]
        return [dict(zip(found, row, strict=True)) for row in zip(*columns, strict=True)]


@dataclass(frozen=True)
class RunOutcome:
    """All that one run produced: a row of its group, at a place in the rollout of its job.

    The twin label is that of the same run from an initial state 1e-6 away, if the sweep asks for
    it.
    """

    plan: RunPlan
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
        """Steps made."""
        return self.rollout.steps[self.place]

    @property
    def controls(self) -> RecordedControls | None:
        """What its policy did; None without one, and where it failed."""
        return self.rollout.controls[self.place] if self.rollout.controls else None


def record_of(task: Task, outcome: RunOutcome) -> EvidenceRecord:
    """Return a run's record without cost and times of day: equal runs have equal records."""
    assessment, row, place = outcome.group.assessment, outcome.row, outcome.place
    status, reason = _status(outcome)
    twin = outcome.twin_label
    return _record(
        task,
        outcome.plan,
        outcome.group.metrics[row],
        _labels(outcome),
        status=status,
        status_reason=reason,
        steps=outcome.steps,
        warnings=dict(outcome.rollout.warnings[place]),
        trajectory_hash=trajectory_hash(outcome.rollout, place),
        knife_edge=None if twin is None else twin != assessment.labels[row][0].label,
        coverage=assessment.coverage and assessment.coverage[row],
    )


def crash_record(task: Task, plan: RunPlan, label: LabelEntry) -> EvidenceRecord:
    """Return the record of a run whose worker died twice: `crashed` or `timeout`."""
    return _record(
        task,
        plan,
        dict.fromkeys(METRICS),
        (label,),
        status=label.label,
        status_reason=label.reason,
        steps=0,
        warnings={},
        trajectory_hash=None,
    )


def _record(
    task: Task,
    plan: RunPlan,
    metrics: dict[str, float | None],
    labels: tuple[LabelEntry, ...],
    **rest: Any,  # noqa: ANN401 - fields of the record, which checks them
) -> EvidenceRecord:
    run, resolved, identity = plan.run, plan.resolved, task.identity
    engine = engine_of(resolved)
    # What its engine ignores is off.
    off = {name: EffectState(False, why) for name, why in engine.ignored(resolved).items()}
    effects = {name: off.get(name, each) for name, each in plan.prepared.effects.items()}
    selected = [each for match, each in task.expected if match.holds(run.values)]
    expected, met, missed = judge(selected, [entry.label for entry in labels], metrics)
    # Of the right types as it is made: to check them takes longer than all else of a short run.
    return EvidenceRecord.model_construct(
        run_id=run.run_id,
        index=run.index,
        sweep=identity.name,
        scene=identity.scene,
        scene_hash=identity.scene_hash,
        engine=Engine(name=engine.name, version=engine.version),
        axes={name: as_written(value) for name, value in run.values.items()},
        settings=resolved.values,
        effects={name: each.on for name, each in effects.items()},
        effect_reasons={name: each.reason for name, each in effects.items()},
        pairs=dict(plan.prepared.pairs),
        edited_geoms=plan.prepared.edited_geoms,
        seed=run.seed,
        initial=_initial(plan.start),
        duration=resolved.duration,
        drive=resolved.drive,
        steps_asked=resolved.steps,
        metrics=metrics,
        metric_versions=identity.metric_versions,
        units={name: metric.unit for name, metric in METRICS.items()},
        label=labels[0].label if labels else "stable",
        labels=labels,
        expected=expected,
        expectation_met=met,
        expectation_reason=missed,
        tolerances_met=within_tolerances(task.sweep.tolerances, metrics),
        provenance=task.provenance,
        plugins=identity.plugins,
        effects_missed={},  # Given, since pydantic takes longer than all this to make its default.
        **rest,
    )


def cost_and_times(task: Task, outcome: RunOutcome) -> dict[str, object]:
    """Return fields of the record of a run that just ended: its cost and times of day."""
    cpu, timestep = float(outcome.rollout.cost[outcome.place]), outcome.plan.resolved.timestep
    known = None if math.isnan(cpu) else (cpu, outcome.steps, timestep, task.sweep.latency_budget)
    return {"started": outcome.started, "finished": time_now(), "cost": known and Cost.of(*known)}


def _initial(start: InitialStates) -> InitialState:
    applied = start.applied[0]
    return InitialState.model_construct(
        qpos=tuple(start.qpos[0].tolist()),
        qvel=tuple(start.qvel[0].tolist()),
        ctrl=tuple(start.ctrl[0].tolist()),
        applied=tuple(applied.tolist()) if applied.any() else (),
    )


def as_written(value: object) -> bool | int | float | str:
    """Return an axis value as it is in its column: several numbers as one string, "0.02 1"."""
    if isinstance(value, tuple):
        return " ".join(_short(number) for number in value)
    assert isinstance(value, (bool, int, float, str))
    return value


def _short(number: object) -> str:
    assert isinstance(number, (int, float))
    return f"{number:g}" if float(f"{number:g}") == number else repr(number)


def _labels(outcome: RunOutcome) -> tuple[LabelEntry, ...]:
    labels = tuple(
        LabelEntry(label=label, reason=reason, step=step)
        for label, reason, step in outcome.group.assessment.labels[outcome.row]
    )
    error = outcome.rollout.errors[outcome.place]
    return labels if error is None else (LabelEntry(label="invalid", reason=error, step=0), *labels)


def _status(outcome: RunOutcome) -> tuple[str, str | None]:
    """Return how a run ended, and why if it ended early."""
    if (error := outcome.rollout.errors[outcome.place]) is not None:
        return "error", error
    if outcome.steps == outcome.plan.resolved.steps:
        return "ok", None
    warnings = ", ".join(outcome.rollout.warnings[outcome.place]) or "no warning"
    return "stopped", f"the engine stopped after {outcome.steps} steps: {warnings}"


@cache
def engine() -> Engine:
    """Return the engine and its version, without loading it."""
    return Engine(name="mujoco", version=version("mujoco"))


def provenance() -> Provenance:
    """Return versions and machine, with the git revision of the current directory."""
    return Provenance(
        contactlab=version("contactlab"),
        git_revision=_revision(),
        python=platform.python_version(),
        numpy=np.__version__,
        host=_host(),
    )


def _host() -> Host:
    info = _cpu_info()
    flags = " ".join(sorted(info.get("flags", "").split()))
    return Host(
        # The first of the others starts a process to find out.
        cpu_model=info.get("model name") or platform.processor() or platform.machine(),
        cpu_flags=hashlib.sha256(flags.encode()).hexdigest()[:16],
        cores=os.cpu_count() or 1,
        os=f"{platform.system()} {platform.release()}",
    )


def _cpu_info() -> dict[str, str]:
    """Return the first processor's entries in /proc/cpuinfo; none without such a file."""
    file = Path("/proc/cpuinfo")
    first = file.read_text(encoding="utf-8").split("\n\n")[0] if file.is_file() else ""
    pairs = (line.partition(":") for line in first.splitlines())
    return {name.strip(): value.strip() for name, _, value in pairs}


def _revision() -> str | None:
    """Return the commit of the working directory, with `+` if files differ from it."""
    # A repository may name a program that watches its files; it may be a stranger's.
    git = ["git", "-c", "core.fsmonitor=false"]
    command = [*git, "describe", "--always", "--abbrev=40", "--dirty=+", "--exclude=*"]
    try:
        done = subprocess.run(  # noqa: S603
            command, capture_output=True, text=True, check=True, timeout=10
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()
