"""Errors against a reference and times: what a sweep asks for, and what a record says of them."""

from typing import Annotated, Literal

from pydantic import Field

from contactlab.schema.model import Model, Whole

# Errors that a sweep may tolerate like metrics, if it asks for them.
ERRORS = ("error_final", "error_mean", "error_peak")

ErrorKind = Literal["trajectory", "local", "invariants"]
SolrefRule = Literal["absolute", "tied"]


class AccuracyAsk(Model):
    """Discretisation errors: each run against its own model at a much finer timestep."""

    error: Literal["auto", "trajectory", "local", "invariants"] = Field(
        default="auto",
        description="trajectory: distance at common times; local: the same, restarted from the "
        "reference's states; invariants: energy and momenta, for chaotic scenes; auto: trajectory "
        "unless a perturbed twin shows chaos",
    )
    refine: Annotated[Whole, Field(ge=2, le=1024)] = Field(
        default=16,
        description="smallest timestep of a run over that of the coarser reference; the finer "
        "one takes half of that",
    )


class TimingAsk(Model):
    """Times: every run once more, alone and interleaved with the others, with nothing recorded."""

    rounds: Annotated[Whole, Field(ge=3, le=1000)] = Field(
        default=3, description="how often each run is timed"
    )


class Accuracy(Model):
    """How far a run is from its reference. Fields are columns of the table, by the same names.

    Errors are in m, angles weighed by the length of their degree of freedom; where `error_kind`
    is `invariants` they are ratios. They are null where run or reference did not go through.
    """

    error_final: float | None = Field(description="At the last common time.")
    error_mean: float | None = Field(description="Mean over common times.")
    error_peak: float | None = Field(description="Largest over common times.")
    error_estimate: float | None = Field(
        description="Largest distance of the two finest references, a bound on what each of the "
        "errors may be off by."
    )
    error_final_estimate: float | None = Field(
        description="Their distance at the end: a smaller `error_final` is not known."
    )
    error_mean_estimate: float | None = Field(
        description="Their mean distance: a smaller `error_mean` is not known."
    )
    error_kind: ErrorKind
    chaotic: bool | None = Field(
        description="Whether a start 1e-8 away grows to the size of the errors; null if unknown."
    )
    reference_integrator: str | None
    reference_timestep: float | None = Field(description="Of the finest reference [s].")
    impacts: int | None = Field(description="How often contacts began or ended in the run.")
    solref_rule: SolrefRule | None = Field(
        description="Whether the time constant of solref is a multiple of the timestep, where "
        "that varies; null where it does not."
    )
    solref_clamped: bool = Field(
        description="Whether refsafe raised a time constant of solref to two timesteps."
    )


class Timing(Model):
    """What a run takes when nothing is recorded. Fields are columns of the table.

    Times are null where the run did not go through.
    """

    time_min: float | None = Field(description="CPU s per simulated s, least of the rounds.")
    time_median: float | None = Field(description="CPU s per simulated s, median of the rounds.")
    step_p50: float | None = Field(description="CPU time of a single step, median [s].")
    step_p99: float | None = Field(description="CPU time of a single step, 99th percentile [s].")
    compile_time: float | None = Field(description="CPU time to compile the model [s].")
    work_steps: float | None = Field(description="Steps per simulated second.")
    work_iterations: float | None = Field(description="Solver iterations per simulated second.")
    work_contacts: float | None = Field(
        description="Contacts, summed over steps, per simulated second."
    )
    work_rows: float | None = Field(
        description="Constraint rows, summed over steps, per simulated second."
    )
    timing_settings: str = Field(description="Hash of how times were measured.")
