"""The report of `contactlab tradeoff`: the time that accuracy costs."""

from typing import Literal

from contactlab.rendering.amounts import format_amount
from contactlab.schema.evidence import Setting
from contactlab.schema.report_model import ReportModel
from contactlab.schema.strict_model import Model, about
from contactlab.schema.task import Task
from contactlab.schema.task_verdict import TaskVerdict

REALITY = "reality"
"""The distance from a recording. Its mean over runs counts, since single runs may be chaotic."""

Settings = dict[str, Setting]


class ErrorMeasure(Model):
    """The error that measures accuracy."""

    name: str = about("The column of runs.parquet.")
    unit: str
    kind: Literal["discretization", "modeling", "metric"]
    against: str | None = about(
        "Kind of a discretization error: trajectory, local or invariants, as in a record."
    )
    reference: Literal["own", "written"] = about(
        "Model whose limit of small steps a discretization error is measured from: the model of "
        "each run, or the model as written.",
        default="own",
    )
    resolution: float = about("Smaller differences are ignored; in the error's unit.")


class TimeMeasure(Model):
    """The time that measures cost: CPU seconds per simulated second, averaged over runs."""

    name: str = about("The column of runs.parquet.")
    source: Literal["timing", "recording"] = about(
        "A separate timing pass, or the recorded runs themselves."
    )
    spread: float | None = about(
        "Median over configurations of median over minimum of the rounds, less 1."
    )


class ConfigurationOutcomes(Model):
    """Successful runs of a configuration: no failure label, every tolerance met."""

    runs: int
    good: int
    low: float = about("Lower end of the 95 % Wilson interval of the rate.")
    high: float = about("Its upper end.")
    labels: dict[str, int] = about("Runs by worst label.")


class Configuration(Model):
    """One setting of all knobs, over all scenarios and seeds."""

    configuration: Settings
    time: float | None = about("CPU seconds per simulated second, mean of its runs.")
    time_worst: float | None = about("The same in its most expensive run.")
    real_time_factor: float | None = about("Simulated over CPU time.")
    error: float | None = about(
        "Largest of its runs, or mean distance from recordings; null if a run has none."
    )
    error_spread: tuple[float, float] | None = about(
        "Least and median error of its runs, if there are several.", default=None
    )
    below_estimate: bool = about(
        "Whether the error is below the uncertainty of the reference, and is an upper bound."
    )
    solref_clamped: bool = about("refsafe raised a solref time constant to 2 timesteps.")
    step_p99: float | None = about("99th percentile of a step's time, worst run [s].")
    ends_elsewhere: str = about(
        "How its bodies end, if that differs from the most accurate one of the same model; it is "
        "not recommended then.",
        default="",
    )
    feasible: bool
    reasons: tuple[str, ...] = about("Why it is not feasible.")
    worst: dict[str, float | None] = about("Largest value of each metric with a tolerance.")
    margins: dict[str, float | None] = about(
        "Tolerance over worst value; null if the worst value is zero or not measured."
    )
    outcomes: ConfigurationOutcomes


class FrontPoint(Model):
    """A point of the Pareto front: no configuration has both less time and less error."""

    configuration: Settings
    time: float
    error: float
    real_time_factor: float


class Order(Model):
    """Rate at which the error falls with the timestep."""

    slope: float | None = about("Of log error against log timestep; null if none.")
    standard_error: float | None
    points: int = about("Number of fitted timesteps.")
    reason: str | None = about("Why there is none.")


class Floor(Model):
    """A modeling error: the part of the error that remains at any timestep, however small."""

    error: float
    points: int = about("Number of timesteps, from the finest up, over which it does not change.")
    timestep: float = about("The longest of these timesteps [s].")


class Method(Model):
    """All knobs except the timestep: one line of the chart."""

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
    equally_fast: tuple[Settings, ...] = about(
        "Feasible configurations that are as fast within noise."
    )
    run_id: str = about("A run of it, for `contactlab show`.")
    mjcf: tuple[str, ...] = about(
        "Its changes of the model files: the line, and its new element.", default=()
    )
    other: Settings = about(
        "Knobs that it changes outside the model files.", default_factory=dict[str, Setting]
    )


class NextStep(Model):
    """The next point of the front: the gain from more time."""

    configuration: Settings
    time_ratio: float = about("Its time over the recommendation's.")
    error_ratio: float | None = about(
        "The recommendation's error over its own; null if its own is zero."
    )


class Blocker(Model):
    """A reason why configurations are not feasible."""

    name: str = about("A tolerance's metric, or a label.")
    kind: Literal["tolerance", "label"]
    configurations: int
    best: float | None = about("Smallest worst value over configurations.")

    @property
    def sentence(self) -> str:
        """The number of configurations that it rules out, and the best value."""
        best = "" if self.best is None else f"; the best has {format_amount(self.best)}"
        return f"{self.kind} {self.name} rules out {self.configurations} configurations{best}"


class TradeoffReport(ReportModel):
    """Time and error over the knobs of a sweep, in its worst scenario and seed."""

    schema_version: Literal[3] = 3
    store: str
    sweep: str
    scene: str
    task: Task | None = about("Task of the runs; null for a stored sweep.", default=None)
    verdict: TaskVerdict | None = about(
        "Verdict on the model as written; null for a stored sweep.", default=None
    )
    knobs: tuple[str, ...]
    units: dict[str, str] = about("SI units of knobs; 1 or empty for none.")
    scenarios: tuple[str, ...]
    insensitive_knobs: tuple[str, ...] = about("Knobs that change no error by more than 1 %.")
    runs_per_configuration: int = about("Scenarios times seeds of each configuration.")
    error: ErrorMeasure
    time: TimeMeasure
    tolerances: dict[str, float]
    chaotic: bool = about("Whether runs are chaotic, so that trajectories cannot be compared.")
    baseline: Configuration | None = about("The model as written, if it was run.", default=None)
    configurations: tuple[Configuration, ...]
    front: tuple[FrontPoint, ...] = about("Over feasible configurations.")
    unconstrained_front: tuple[FrontPoint, ...] = about("Over all of them.")
    methods: tuple[Method, ...] = about("With one value of each insensitive knob.")
    recommendation: Recommendation | None
    robust: Recommendation | None = about(
        "The cheapest configuration with all margins at least 1.25."
    )
    next_step: NextStep | None
    blockers: tuple[Blocker, ...] = about("The most frequent first.")
    notes: tuple[str, ...]

    @property
    def problem(self) -> str:
        """Why no configuration can be recommended, if none can."""
        if self.recommendation is not None:
            return ""
        reason = "".join(f": {blocker.sentence}" for blocker in self.blockers[:1])
        which = "mujoco's" if self.front else str(len(self.configurations))
        return f"none of {which} configurations is feasible{reason}"

    @property
    def varying(self) -> list[str]:
        """Knobs that differ between configurations."""
        values = [configuration.configuration for configuration in self.configurations]
        return [name for name in self.knobs if len({value[name] for value in values}) > 1]
