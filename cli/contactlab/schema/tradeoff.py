"""What accuracy costs in time: the answer of `contactlab tradeoff`."""

from typing import Literal

from pydantic import Field

from contactlab.schema.model import Model
from contactlab.schema.record import Setting

TRADEOFF_VERSION = 1

Settings = dict[str, Setting]


class ErrorMeasure(Model):
    """What stands for accuracy."""

    name: str = Field(description="The column of runs.parquet.")
    unit: str
    kind: Literal["discretisation", "modelling", "metric"]
    against: str | None = Field(
        description="Of a discretisation error: trajectory, local or invariants, as in a record."
    )
    resolution: float = Field(description="Below it two errors are equal; in the error's unit.")


class TimeMeasure(Model):
    """What stands for cost: CPU seconds per simulated second, averaged over runs."""

    name: str = Field(description="The column of runs.parquet.")
    source: Literal["timing", "recording"] = Field(
        description="A timing pass of its own, or the recorded runs themselves."
    )
    spread: float | None = Field(
        description="Median over configurations of median over minimum of the rounds, less 1."
    )


class Outcomes(Model):
    """How many runs of a configuration are as wanted: no failure label, every tolerance met."""

    runs: int
    good: int
    low: float = Field(description="Lower end of the rate's 95 % interval after Wilson.")
    high: float = Field(description="Its upper end.")
    labels: dict[str, int] = Field(description="Runs by worst label.")


class Configuration(Model):
    """One setting of all knobs, over all scenarios and seeds."""

    configuration: Settings
    time: float | None = Field(description="CPU seconds per simulated second, mean of its runs.")
    time_worst: float | None = Field(description="The same in its most expensive run.")
    real_time_factor: float | None = Field(description="Simulated over CPU time.")
    error: float | None = Field(description="Largest in any of its runs; null if one has none.")
    below_estimate: bool = Field(
        description="The error is below what the reference itself may be off by: an upper bound."
    )
    solref_clamped: bool = Field(description="The engine softened its contacts to suit the step.")
    step_p99: float | None = Field(description="99th percentile of a step's time, worst run [s].")
    feasible: bool
    reasons: tuple[str, ...] = Field(description="Why it is not feasible.")
    worst: dict[str, float | None] = Field(description="Largest size of each tolerated metric.")
    margins: dict[str, float | None] = Field(
        description="Tolerance over worst value; null if that is zero or was not measured."
    )
    outcomes: Outcomes


class FrontPoint(Model):
    """A configuration that no other beats in both time and error."""

    configuration: Settings
    time: float
    error: float
    real_time_factor: float


class Order(Model):
    """How fast the error falls with the timestep."""

    slope: float | None = Field(description="Of log error against log timestep; null if none.")
    standard_error: float | None
    points: int = Field(description="Timesteps that it was fitted to.")
    reason: str | None = Field(description="Why there is none.")


class Floor(Model):
    """A modelling error: what remains however small the timestep is."""

    error: float
    points: int = Field(description="Timesteps, from the finest up, over which it does not move.")
    timestep: float = Field(description="The longest of them [s].")


class Method(Model):
    """All knobs but the timestep: one line of the chart."""

    name: str
    configuration: Settings
    order: Order
    floor: Floor | None


class Recommendation(Model):
    """A configuration to use."""

    configuration: Settings
    margins: dict[str, float | None]
    time: float
    error: float | None
    real_time_factor: float
    equally_fast: tuple[Settings, ...] = Field(
        description="Feasible configurations that time cannot tell from the cheapest."
    )
    run_id: str = Field(description="A run of it, for `contactlab show`.")
    mjcf: tuple[str, ...] = Field(description="Lines that set it in a model.")
    other: Settings = Field(description="Knobs that MJCF has no option or default for.")


class NextStep(Model):
    """What the next step of cost buys."""

    configuration: Settings
    time_ratio: float = Field(description="Its time over the recommendation's.")
    error_ratio: float | None = Field(
        description="The recommendation's error over its own; null if its own is zero."
    )


class Blocker(Model):
    """What keeps configurations from being feasible."""

    name: str = Field(description="A tolerance's metric, or a label.")
    kind: Literal["tolerance", "label"]
    configurations: int
    best: float | None = Field(description="Least worst value of the metric over configurations.")


class TradeoffReport(Model):
    """What accuracy costs in time, over the knobs of a sweep, in its worst scenario and seed."""

    schema_version: Literal[1] = TRADEOFF_VERSION
    store: str
    sweep: str
    scene: str
    knobs: tuple[str, ...]
    scenarios: tuple[str, ...]
    idle: tuple[str, ...] = Field(description="Knobs that change no error by more than 1 %.")
    cases: int = Field(description="Scenarios times seeds that a configuration is run in.")
    error: ErrorMeasure
    time: TimeMeasure
    tolerances: dict[str, float]
    chaotic: bool = Field(description="Whether runs part from each other however they start.")
    configurations: tuple[Configuration, ...]
    front: tuple[FrontPoint, ...] = Field(description="Over feasible configurations.")
    unconstrained_front: tuple[FrontPoint, ...] = Field(description="Over all of them.")
    methods: tuple[Method, ...] = Field(description="With one value of each idle knob.")
    recommendation: Recommendation | None
    robust: Recommendation | None = Field(
        description="The cheapest whose margins are all at least 1.25."
    )
    next_step: NextStep | None
    blockers: tuple[Blocker, ...] = Field(description="The most frequent first.")
    notes: tuple[str, ...]
