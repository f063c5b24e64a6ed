"""The reports of `contactlab check` and `contactlab stability`, and the reference of a run."""

from typing import Literal

from pydantic import RootModel

from contactlab.schema.drive import Drive
from contactlab.schema.evidence import Engine, Provenance, Setting
from contactlab.schema.finding import LEVEL, Finding, Level
from contactlab.schema.strict_model import Model, about
from contactlab.schema.task import Task
from contactlab.schema.task_verdict import TaskVerdict

CHECK_VERSION = 3

CheckVerdict = Literal["pass", "warning", "fail", "not applicable"]
TaskKind = Literal["manipulation", "locomotion"]


class Measure(Model):
    """One number that a check measured."""

    name: str
    of: str | None = about("The pair, body or setting that it belongs to; null if all.")
    value: float | None = about("Null where it could not be measured.")
    unit: str
    limit: float | None = about("Its limit; null if it is only reported.")
    holds: bool | None = about("Whether the limit is met; null if it is only reported.")
    level: Level = about(f"Of a limit that is missed. {LEVEL}.", default="note")


class CheckResult(Model):
    """One check of a model."""

    name: str = about("timestep, free_motion, flat_contact, hold, repeat, shells; or a plug-in's")
    asks: str = about("The question that it answers.")
    verdict: CheckVerdict
    reason: str
    measures: tuple[Measure, ...] = ()
    notes: tuple[str, ...] = about("Further remarks.", default=())
    stores: tuple[str, ...] = about(
        "Its evidence: stores, relative to the folder of the check.", default=()
    )


class Edit(Model):
    """An element as it is then, and where it stands in the model's files; none if it is removed."""

    where: str
    lines: tuple[str, ...]


class Remedy(Model):
    """A change that was run on the model together with those before it in the list."""

    settings: dict[str, Setting] = about("The change, as axes of a sweep.")
    mends: tuple[str, ...] = about("The findings that no longer fail with it.")
    time: float | None = about(
        "CPU time of stepping with it and those before it, over that of the model as "
        "it is; null if that was not measured."
    )
    edits: tuple[Edit, ...] = about("The change of the model's file.")


class CheckReport(Model):
    """Every check of one model (`check.json`). Units are SI; each measure names its own."""

    check_version: Literal[3] = CHECK_VERSION
    model: str = about("The model as given.")
    scene: str
    scene_hash: str
    task: Task = about("What it is judged on.")
    verdict: TaskVerdict | None = about(
        "What the runs of the task come to; null if that was not asked.", default=None
    )
    overrides: tuple[str, ...] = about("--set, as given.")
    keyframe: str | None = about("The keyframe that runs start from; null if none.")
    drive: Drive = about("What drives the runs of the model itself.")
    kind: TaskKind
    kind_reason: str
    settings: dict[str, Setting] = about("Every resolved setting, defaults included.")
    engine: Engine
    provenance: Provenance
    passed: bool = about("Whether no gate fails that is not accepted.")
    checks: tuple[CheckResult, ...]
    findings: tuple[Finding, ...] = about("What was judged, failures first.")
    remedies: tuple[Remedy, ...] = about("Changes that help, each with those above.")
    notes: tuple[str, ...] = about("Acceptances that are stale, remedies not found.")
    not_exercised: tuple[str, ...] = about(
        "What of the model its own runs did not exercise, a line by kind with names.", default=()
    )


class Reference(Model):
    """One run of one environment, which a parallel engine must reproduce (`reference.json`)."""

    check_version: Literal[1] = 1
    scene: str
    scene_hash: str
    store: str = about("The store that holds the run, relative to this file.")
    run_id: str
    trajectory_hash: str
    engine: Engine
    settings: dict[str, Setting]
    seed: int
    duration: float = about("s")
    success: bool = about("Whether the run is labelled stable.")
    label: str
    metrics: dict[str, float] = about("Values to reproduce, by metric.")
    units: dict[str, str]
    tolerance: float = about("Largest relative difference from each metric.")
    resolution: dict[str, float] = about("Absolute differences below this count as none.")


class StabilityResult(Model):
    """One hard case."""

    name: str
    runs: int
    asked: int = about("Runs that an expectation applies to.")
    met: int = about("How many of these were as expected.")
    controls: int = about("Runs that are expected to fail, and did.")
    labels: dict[str, int] = about("Runs by worst label.")
    error: float | None = about(
        "Largest oracle error of runs that are expected to be stable; null without an oracle."
    )
    step: int | None = about("Earliest step at which such a run failed; null if none did.")
    misses: tuple[str, ...] = about("Unmet expectations, by the start of a run's id.")
    seconds: float = about("Wall time [s].")
    store: str = about("The evidence.")
    task: Task | None = about("What a model is judged on; null for a case.", default=None)
    verdict: TaskVerdict | None = about(
        "What the runs of that task come to; null for a case.", default=None
    )
    not_exercised: tuple[str, ...] = about(
        "What of a model no run exercised, a line by kind with names.", default=()
    )
    left_out: tuple[str, ...] = about("Why runs that need a newer engine were left out.")

    @property
    def passed(self) -> bool:
        """Whether there were expectations, all were met, and the numerics are sound."""
        return self.met == self.asked > 0 and (self.verdict is None or self.verdict.sound)


class StabilityReport(RootModel[tuple[StabilityResult, ...]]):
    """Every case that could be run."""

    @property
    def cases(self) -> tuple[StabilityResult, ...]:
        """The results, in the order of the cases."""
        return self.root

    @property
    def passed(self) -> bool:
        """True if every case passed."""
        return all(report.passed for report in self.root)
