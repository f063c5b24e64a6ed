"""The reports of `contactlab check` and `contactlab stability`, and the reference of a run."""

from typing import Literal

from pydantic import Field, RootModel

from contactlab.schema.drive import Drive
from contactlab.schema.evidence import Engine, Provenance, Setting
from contactlab.schema.judged_check import JudgedCheck
from contactlab.schema.strict_model import Model

CHECK_VERSION = 2

CheckName = Literal["timestep", "free_motion", "flat_contact", "hold", "repeat", "shells"]
CheckVerdict = Literal["pass", "warning", "fail", "not applicable"]
Severity = Literal["error", "warning", "note"]
TaskKind = Literal["manipulation", "locomotion"]


class Measure(Model):
    """One number that a check measured."""

    name: str
    of: str | None = Field(description="The pair, body or setting that it belongs to; null if all.")
    value: float | None = Field(description="Null where it could not be measured.")
    unit: str
    limit: float | None = Field(description="Its limit; null if it is only reported.")
    holds: bool | None = Field(description="Whether the limit is met; null if it is only reported.")
    severity: Severity = Field(default="note", description="What it means to miss the limit.")


class CheckResult(Model):
    """One check of a model."""

    name: CheckName
    asks: str = Field(description="The question that it answers.")
    verdict: CheckVerdict
    reason: str
    measures: tuple[Measure, ...] = ()
    notes: tuple[str, ...] = Field(default=(), description="Further remarks.")
    stores: tuple[str, ...] = Field(
        default=(), description="Its evidence: stores, relative to the folder of the check."
    )


class Finding(JudgedCheck):
    """All measures of one name against their limit, or a check that does not apply."""

    check: CheckName
    severity: Severity = Field(description="What it means if it fails and is not accepted.")


class Edit(Model):
    """Lines of MJCF and where they belong, tried by compiling the model with them."""

    where: str
    lines: tuple[str, ...]


class Remedy(Model):
    """A change that was run on the model together with those before it in the list."""

    settings: dict[str, Setting] = Field(description="The change, as axes of a sweep.")
    mends: tuple[str, ...] = Field(description="The findings that no longer fail with it.")
    time: float | None = Field(
        description="CPU time of stepping with it and those before it, over that of the model as "
        "it is; null if that was not measured."
    )
    edits: tuple[Edit, ...] = Field(description="The change of the model's file.")


class CheckReport(Model):
    """Every check of one model (`check.json`). Units are SI; each measure names its own."""

    check_version: Literal[2] = CHECK_VERSION
    model: str = Field(description="The model as given.")
    scene: str
    scene_hash: str
    overrides: tuple[str, ...] = Field(description="--set, as given.")
    keyframe: str | None = Field(description="The keyframe that runs start from; null if none.")
    drive: Drive = Field(description="What drives the runs of the model itself.")
    kind: TaskKind
    kind_reason: str
    settings: dict[str, Setting] = Field(description="Every resolved setting, defaults included.")
    engine: Engine
    provenance: Provenance
    passed: bool = Field(description="Whether there is no error that is not accepted.")
    checks: tuple[CheckResult, ...]
    findings: tuple[Finding, ...] = Field(description="What was judged, errors first.")
    remedies: tuple[Remedy, ...] = Field(description="Changes that help, each with those above.")
    notes: tuple[str, ...] = Field(description="Acceptances that are stale, remedies not found.")


class Reference(Model):
    """One run of one environment, which a parallel engine must reproduce (`reference.json`)."""

    check_version: Literal[1] = 1
    scene: str
    scene_hash: str
    store: str = Field(description="The store that holds the run, relative to this file.")
    run_id: str
    trajectory_hash: str
    engine: Engine
    settings: dict[str, Setting]
    seed: int
    duration: float = Field(description="s")
    success: bool = Field(description="Whether the run is labelled stable.")
    label: str
    metrics: dict[str, float] = Field(description="Values to reproduce, by metric.")
    units: dict[str, str]
    tolerance: float = Field(description="Largest relative difference from each metric.")
    resolution: dict[str, float] = Field(
        description="Absolute differences below this count as none."
    )


class StabilityResult(Model):
    """One hard case."""

    name: str
    runs: int
    asked: int = Field(description="Runs that an expectation applies to.")
    met: int = Field(description="How many of these were as expected.")
    controls: int = Field(description="Runs that are expected to fail, and did.")
    labels: dict[str, int] = Field(description="Runs by worst label.")
    error: float | None = Field(
        description="Largest oracle error of runs that are expected to be stable; null without "
        "an oracle."
    )
    step: int | None = Field(
        description="Earliest step at which such a run failed; null if none did."
    )
    misses: tuple[str, ...] = Field(description="Unmet expectations, by the start of a run's id.")
    seconds: float = Field(description="Wall time [s].")
    store: str = Field(description="The evidence.")
    not_exercised: str | None = Field(
        default=None, description="What of a model no run exercised, and the drive that would."
    )
    left_out: tuple[str, ...] = Field(
        description="Why runs that need a newer engine were left out."
    )

    @property
    def passed(self) -> bool:
        """Whether there were expectations, and all were met."""
        return self.met == self.asked > 0


class StabilityReport(RootModel[tuple[StabilityResult, ...]]):
    """Every case that could be run."""

    @property
    def cases(self) -> tuple[StabilityResult, ...]:
        """The results, in the order of the cases."""
        return self.root

    @property
    def passed(self) -> bool:
        """Whether every case passed."""
        return all(each.passed for each in self.root)
