"""The policy file of `contactlab compare`: what counts as regressed, and what fails the job."""

from datetime import date
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from contactlab.schema.judged_check import Acceptances, Count
from contactlab.schema.strict_model import Model, Sha256, Tolerance, Word

Level = Literal["gate", "warn", "note"]
Better = Literal["lower", "higher", "none"]
Statistic = Literal["each", "mean", "median", "worst", "ratio"]
Sameness = Literal[
    "sweep",
    "scene",
    "scene_hash",
    "metric_versions",
    "thresholds",
    "engine",
    "contactlab",
    "python",
    "numpy",
    "cpu_model",
    "cpu_flags",
    "os",
]
LEVEL = "gate: fails the job; warn: a warning; note: reported only"


class Require(Model):
    """What both stores must have in common."""

    same: tuple[Sameness, ...] = Field(
        default=("scene_hash", "metric_versions", "thresholds"),
        description="what must be the same; otherwise what depends on it is not comparable; "
        "a changed scene is only reported when runs are matched by axes",
    )
    warn_if_different: tuple[Sameness, ...] = Field(
        default=("engine", "contactlab", "numpy", "cpu_model", "cpu_flags"),
        description="reported if different",
    )


class AllowedTransition(Model):
    """A change of the worst label that is known and accepted."""

    from_: Word = Field(alias="from", description="worst label in the baseline")
    to: Word = Field(description="worst label in the candidate")
    max: Count = Field(description="how many runs may change this way")
    reason: Word = Field(description="why it is accepted")
    until: date | None = Field(default=None, description="last accepted day, YYYY-MM-DD")


class LabelRules(Model):
    """How labels are compared."""

    severity: tuple[Word, ...] | None = Field(
        default=None, description="labels, worst first; as stored if left out"
    )
    level: Level = Field(default="gate", description=f"of a new label; {LEVEL}")
    by: tuple[Word, ...] = Field(default=(), description="axes; each value is judged separately")
    allow: tuple[AllowedTransition, ...] = Field(
        default=(), description="changes of the worst label that are accepted"
    )

    @model_validator(mode="after")
    def _names_no_label_twice(self) -> Self:
        severity = self.severity or ()
        if len(set(severity)) < len(severity):
            raise PydanticCustomError("severity_twice", "names a label twice in its severity")
        return self


class MetricRule(Model):
    """How a metric is compared; keys left out come from a wider pattern or the defaults."""

    better: Better | None = Field(
        default=None, description="lower, higher or none; as stored with the metric if left out"
    )
    rel: Tolerance | None = Field(
        default=None, description="largest accepted change, relative to the baseline's value"
    )
    abs: Tolerance | None = Field(
        default=None, description="further accepted change, in the metric's unit"
    )
    statistic: Statistic | None = Field(
        default=None,
        description="what is compared: each run, the mean, median or worst of all runs, or the "
        "median ratio of the pairs",
    )
    by: tuple[Word, ...] | None = Field(
        default=None, description="axes; each of their values is judged separately"
    )
    budget: Tolerance | None = Field(
        default=None, description="share of the runs that may regress, with a warning"
    )
    level: Level | None = Field(default=None, description=LEVEL)
    needs_same: tuple[Sameness, ...] | None = Field(
        default=None, description="what must be the same for this metric to be comparable"
    )


class KnifeEdgeRules(Model):
    """How runs are treated whose label changes from a start 1e-6 away."""

    exclude: Annotated[bool, Field(strict=True)] = Field(
        default=True, description="whether they are counted and reported, never gated"
    )
    max_share: Tolerance = Field(
        default=0.05, description="accepted share of such runs, if larger than the baseline's"
    )
    level: Level = Field(default="warn", description=f"beyond that share; {LEVEL}")


class RecommendationRules(Model):
    """How a change of the recommended configuration is treated."""

    changed: Level = Field(default="warn", description=f"of a changed recommendation; {LEVEL}")


class ComparePolicy(Acceptances):
    """What counts as regressed, and what fails the job."""

    match: Literal["id", "axes"] = Field(
        default="id", description="how runs are paired: by run id, or by axis values and seed"
    )
    baseline_digest: Sha256 | None = Field(
        default=None, description="digest of the only baseline, as `baseline update` prints it"
    )
    require: Require = Field(default_factory=Require, description="what must be the same")
    labels: LabelRules = Field(default_factory=LabelRules, description="how labels are compared")
    metrics: dict[str, MetricRule] = Field(
        default={},
        description="metric name, or a pattern such as solver_*, to its rule; the closest one wins",
    )
    expectations: Level = Field(
        default="gate", description=f"of runs that are no longer as expected; {LEVEL}"
    )
    missing_runs: Level = Field(
        default="gate", description=f"of runs that only the baseline has; {LEVEL}"
    )
    new_runs: Level = Field(
        default="note", description=f"of runs that only the candidate has; {LEVEL}"
    )
    knife_edge: KnifeEdgeRules = Field(
        default_factory=KnifeEdgeRules, description="knife-edge runs"
    )
    recommendation: RecommendationRules = Field(
        default_factory=RecommendationRules, description="the recommended configuration"
    )
