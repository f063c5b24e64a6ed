"""The report of `contactlab tune`: the settings to use, and the proof that they are as good."""

from typing import Literal

from pydantic import Field

from contactlab.schema.effects_report import Ratio
from contactlab.schema.evidence import Engine, Provenance, Setting
from contactlab.schema.strict_model import Model

TUNE_VERSION = 1
REPORT, MODEL, PATCH, PROOF = "tune.json", "tuned.xml", "tuned.patch", "proof.yaml"
"""Files of the study's folder; the model lies in a folder of its own, with what it refers to."""

Goal = Literal["fastest", "most-accurate"]
Standing = Literal["now", "recommended", "safer", "more accurate"]


class Candidate(Model):
    """One configuration, in all runs of its sweep; errors are the largest over them."""

    standing: Standing
    settings: dict[str, Setting] = Field(description="What differs from the model as written.")
    error_final: float | None = Field(description="m")
    error_mean: float | None = Field(description="m")
    error_peak: float | None = Field(description="m")
    error_velocity: float | None = Field(description="m/s, mean over time")
    error_energy: float | None = Field(description="As a ratio, mean over time.")
    labels: dict[str, int] = Field(description="Runs by worst label.")
    time: float | None = Field(description="CPU seconds per simulated second.")
    cost: Ratio | None = Field(description="Time over that of the model as written.")
    excess: float | None = Field(
        description="Largest size of what is limited, over its limit; null if a run fails."
    )


class Changed(Model):
    """A setting that is recommended, and what it was."""

    name: str
    before: Setting
    after: Setting


class Kept(Model):
    """What was not tried, or not changed, and why."""

    name: str
    reason: str


class Line(Model):
    """A line of a file of the model, as the patch makes it; empty if it goes."""

    file: str
    line: int
    element: str


class Proof(Model):
    """The written model and the model as written, from fresh seeds under the same drive."""

    seeds: tuple[int, ...]
    holds: bool
    reason: str
    same_runs: int = Field(
        description="Runs of the file equal to those of the settings, bit for bit."
    )
    now: Candidate
    tuned: Candidate


class TuneReport(Model):
    """From a model to the settings to use (`tune.json`). Units are SI."""

    tune_version: Literal[1] = TUNE_VERSION
    model: str = Field(description="As given.")
    scene_hash: str
    goal: Goal
    drive: str
    duration: float = Field(description="s")
    limits: dict[str, float] = Field(description="Largest error, and of metrics, by column.")
    asked: bool = Field(description="Whether the error was asked for; else it is that of now.")
    divergence: float | None = Field(
        description="How far a start 1e-8 away parts from the reference [m]."
    )
    engine: Engine
    provenance: Provenance
    candidates: tuple[Candidate, ...] = Field(description="Now first, from the same seeds.")
    changes: tuple[Changed, ...]
    masked: tuple[str, ...] = Field(description="Geoms that never touch, taken from collisions.")
    excluded: tuple[tuple[str, str], ...] = Field(description="Bodies that never touch.")
    sensors: tuple[str, ...] = Field(description="Sensors that were left out.")
    profile: dict[str, Ratio] = Field(
        description="Time of a step of the model as written without a part, over that with it."
    )
    kept: tuple[Kept, ...]
    proof: Proof | None = Field(description="Null if nothing is recommended.")
    file: str | None = Field(description="The written model, relative to the report.")
    lines: tuple[Line, ...] = Field(description="What the patch changes.")
    ended: str = Field(description="When the search ended early; empty if it did not.")
    tried: int = Field(description="Configurations that were judged.")
    runs: int = Field(description="Runs in all stores.")
    stores: tuple[str, ...] = Field(description="The evidence, relative to the report.")
