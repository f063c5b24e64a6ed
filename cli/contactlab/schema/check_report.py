"""The report of `contactlab check`, and the reference that another engine must reproduce."""

from typing import Literal

from pydantic import Field

from contactlab.schema.evidence import Engine, Provenance, Setting
from contactlab.schema.strict_model import Model

CHECK_VERSION = 1

CheckName = Literal["timestep", "free_motion", "flat_contact", "hold", "repeat", "shells"]
CheckVerdict = Literal["pass", "fail", "not applicable"]
TaskKind = Literal["manipulation", "locomotion"]


class Measure(Model):
    """One number that a check measured."""

    name: str
    of: str | None = Field(description="The pair, body or setting that it belongs to; null if all.")
    value: float | None = Field(description="Null where it could not be measured.")
    unit: str
    limit: float | None = Field(description="Its limit; null if it is only reported.")
    holds: bool | None = Field(description="Whether the limit is met; null if it is only reported.")


class Change(Model):
    """A change of the model, and the outcome of running the model with it."""

    lines: tuple[str, ...] = Field(description="MJCF, ready to paste.")
    settings: dict[str, Setting] = Field(description="The same as axes of a sweep.")
    cures: bool | None = Field(description="Whether the check then passed; null if it was not run.")
    shown: str = Field(description="The outcome of running it.")


class CheckResult(Model):
    """One check of a model."""

    name: CheckName
    asks: str = Field(description="The question that it answers.")
    verdict: CheckVerdict
    reason: str
    measures: tuple[Measure, ...] = ()
    changes: tuple[Change, ...] = ()
    notes: tuple[str, ...] = Field(default=(), description="Further remarks.")
    stores: tuple[str, ...] = Field(
        default=(), description="Its evidence: stores, relative to the folder of the check."
    )


class CheckReport(Model):
    """Every check of one model (`check.json`). Units are SI; each measure names its own."""

    check_version: Literal[1] = CHECK_VERSION
    model: str = Field(description="The model as given.")
    scene: str
    scene_hash: str
    overrides: tuple[str, ...] = Field(description="--set, as given.")
    keyframe: str | None = Field(description="The keyframe that runs start from; null if none.")
    kind: TaskKind
    kind_reason: str
    settings: dict[str, Setting] = Field(description="Every resolved setting, defaults included.")
    engine: Engine
    provenance: Provenance
    passed: bool = Field(description="Whether no check failed.")
    checks: tuple[CheckResult, ...]


class Reference(Model):
    """One run of one environment, which a parallel engine must reproduce (`reference.json`)."""

    check_version: Literal[1] = CHECK_VERSION
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
