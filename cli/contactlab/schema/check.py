"""What `contactlab check` finds of a model, and the reference that another engine must meet."""

from typing import Literal

from pydantic import Field

from contactlab.schema.model import Model
from contactlab.schema.record import Engine, Provenance, Setting

CHECK_VERSION = 1

CheckName = Literal["timestep", "free_motion", "flat_contact", "hold", "repeat", "shells"]
CheckVerdict = Literal["pass", "fail", "not applicable"]
TaskKind = Literal["manipulation", "locomotion"]


class Measure(Model):
    """One number that a check looked at."""

    name: str
    of: str | None = Field(description="The pair, body or setting that it belongs to; null if all.")
    value: float | None = Field(description="Null where it could not be measured.")
    unit: str
    limit: float | None = Field(description="What it is held against; null if it only informs.")
    holds: bool | None = Field(description="Whether the limit is kept; null if it only informs.")


class Change(Model):
    """What to change in the model, and what came of running the model with it."""

    lines: tuple[str, ...] = Field(description="MJCF, ready to paste.")
    settings: dict[str, Setting] = Field(description="The same as axes of a sweep.")
    cures: bool | None = Field(description="Whether it met the check when run; null if not run.")
    shown: str = Field(description="What running it gave.")


class CheckResult(Model):
    """One check of a model."""

    name: CheckName
    asks: str = Field(description="What is asked of the model.")
    verdict: CheckVerdict
    reason: str
    measures: tuple[Measure, ...] = ()
    changes: tuple[Change, ...] = ()
    notes: tuple[str, ...] = Field(default=(), description="What else should be known.")
    stores: tuple[str, ...] = Field(
        default=(), description="Its evidence: stores, relative to the folder of the check."
    )


class CheckReport(Model):
    """Every check of one model (`check.json`). Units are SI; each measure names its own."""

    check_version: Literal[1] = CHECK_VERSION
    model: str = Field(description="As it was asked for.")
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
    """One run of one environment, which a parallel engine must meet (`reference.json`)."""

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
    metrics: dict[str, float] = Field(description="What must be met, by name of the metric.")
    units: dict[str, str]
    tolerance: float = Field(description="Largest relative difference from each metric.")
    resolution: dict[str, float] = Field(
        description="Differences below this are none, whatever their share."
    )
