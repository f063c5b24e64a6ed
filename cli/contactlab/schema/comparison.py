"""The policy file and the report of `contactlab compare`.

The policy defines regressions, gates and waivers.
"""

from datetime import date
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from contactlab.schema.finding import LEVEL, Change, Count, Finding, Level, Waivers
from contactlab.schema.strict_model import Flag, Model, Sha256, Tolerance, Word, about

Better = Literal["lower", "higher", "none"]
Statistic = Literal["each", "mean", "median", "worst", "ratio"]
Sameness = Literal[
    "sweep",
    "scene",
    "scene_hash",
    "settings",
    "metric_versions",
    "thresholds",
    "demands",
    "engine",
    "contactlab",
    "python",
    "numpy",
    "cpu_model",
    "cpu_flags",
    "os",
]


class Require(Model):
    """Properties that both stores must have in common."""

    same: tuple[Sameness, ...] = about(
        "properties that must be the same; otherwise the checks that depend on them are skipped; "
        "a changed scene is only reported when runs are matched by axes",
        default=("scene_hash", "metric_versions", "thresholds", "demands"),
    )
    warn_if_different: tuple[Sameness, ...] = about(
        "reported if different",
        default=("settings", "engine", "contactlab", "numpy", "cpu_model", "cpu_flags"),
    )


class AllowedTransition(Model):
    """An allowed change of the worst label."""

    from_: Word = about("worst label in the baseline", alias="from")
    to: Word = about("worst label in the candidate")
    max: Count = about("largest number of runs that may change this way")
    reason: Word = about("why it is allowed")
    until: date | None = about("last allowed day, YYYY-MM-DD", default=None)


class LabelRules(Model):
    """Comparison of labels."""

    severity: tuple[Word, ...] | None = about(
        "labels, worst first; in the order of this contactlab if left out", default=None
    )
    level: Level = about(f"of a new label; {LEVEL}", default="gate")
    by: tuple[Word, ...] = about("axes; each value is judged separately", default=())
    allow: tuple[AllowedTransition, ...] = about("allowed changes of the worst label", default=())

    @model_validator(mode="after")
    def _names_no_label_twice(self) -> Self:
        severity = self.severity or ()
        if len(set(severity)) < len(severity):
            raise PydanticCustomError("severity_twice", "names a label twice in its severity")
        return self


class MetricRule(Model):
    """Comparison of a metric; keys left out come from a wider pattern or the defaults."""

    better: Better | None = about(
        "lower, higher or none; as stored with the metric if left out", default=None
    )
    rel: Tolerance | None = about(
        "largest allowed change, relative to the baseline's value", default=None
    )
    abs: Tolerance | None = about("further allowed change, in the metric's unit", default=None)
    statistic: Statistic | None = about(
        "compared value: each run, the mean, median or worst of all runs, or the "
        "median ratio of the pairs",
        default=None,
    )
    by: tuple[Word, ...] | None = about(
        "axes; each of their values is judged separately", default=None
    )
    budget: Tolerance | None = about(
        "share of the runs that may regress, with a warning", default=None
    )
    level: Level | None = about(LEVEL, default=None)
    needs_same: tuple[Sameness, ...] | None = about(
        "properties that must be the same to compare this metric", default=None
    )


class OutcomeRules(Model):
    """Comparison of the share of good runs."""

    good: Literal["success", "stable"] = about(
        "which runs are good: episodes that their loop calls a success, or stable ones",
        default="success",
    )
    tolerance: Tolerance = about(
        "allowed loss of the share; a check fails if the interval of the loss lies beyond it",
        default=0.0,
    )
    in_a_row: Annotated[int, Field(ge=1, le=1000)] = about(
        "k of pass^k, reported next to the shares: the probability that k runs are all good",
        default=3,
    )
    level: Level = about(f"of a smaller share; {LEVEL}", default="gate")


class KnifeEdgeRules(Model):
    """Treatment of runs with another label from a start 1e-6 away."""

    exclude: Flag = about("whether they are counted and reported, never gated", default=True)
    max_share: Tolerance = about(
        "allowed share of such runs, if larger than the baseline's", default=0.05
    )
    level: Level = about(f"beyond that share; {LEVEL}", default="warn")


class RecommendationRules(Model):
    """Treatment of a change of the recommended configuration."""

    changed: Level = about(f"of a changed recommendation; {LEVEL}", default="warn")


class ComparePolicy(Waivers):
    """Rules that say which changes are regressions, and which of these fail the job."""

    match: Literal["auto", "id", "axes", "none"] = about(
        "how runs are paired: by run id, by axis values and seed, or not at all, so that only "
        "the shares of good ones are compared; auto: by id if an id is common, otherwise by axes",
        default="auto",
    )
    judge: Literal["auto", "each", "spread"] = about(
        "each: by each pair of runs; spread: by all pairs together, with intervals, so that single "
        "runs decide nothing; auto: spread if the model changed and there are enough pairs",
        default="auto",
    )
    baseline_digest: Sha256 | None = about(
        "digest of the only baseline, as `compare --update` prints it", default=None
    )
    require: Require = about("properties that must be the same", default_factory=Require)
    labels: LabelRules = about("how labels are compared", default_factory=LabelRules)
    metrics: dict[str, MetricRule] = about(
        "metric name, or a pattern such as solver_*, to its rule; the closest one wins", default={}
    )
    outcomes: OutcomeRules = about("how outcomes are compared", default_factory=OutcomeRules)
    expectations: Level = about(f"of runs that are no longer as expected; {LEVEL}", default="gate")
    missing_runs: Level = about(f"of runs that only the baseline has; {LEVEL}", default="gate")
    new_runs: Level = about(f"of runs that only the candidate has; {LEVEL}", default="note")
    least_judged: Tolerance = about(
        "share of the candidate's runs, of its metrics and of each metric's values that the "
        "baseline must allow to judge; with less the stores are not comparable",
        default=0.75,
    )
    knife_edge: KnifeEdgeRules = about("knife-edge runs", default_factory=KnifeEdgeRules)
    recommendation: RecommendationRules = about(
        "the recommended configuration", default_factory=RecommendationRules
    )


class ComparedStore(Model):
    """One side of a comparison."""

    store: str
    physics: str = about(
        "Digest of the results, without clocks and costs: the same for two honest repeats.",
        default="",
    )
    sweep: str
    runs: int
    engine: str
    contactlab: str
    git_revision: str | None
    cpu_model: str
    finished: str


class Difference(Model):
    """A difference between the stores."""

    what: str
    baseline: str
    candidate: str
    required: bool = about("Whether the policy requires equality.")


class Transition(Model):
    """Runs with another worst label."""

    baseline: str
    candidate: str
    runs: int
    verdict: Change


class PairCounts(Model):
    """Numbers of runs, by pairing."""

    paired: int
    missing: int = about("Only in the baseline.")
    new: int = about("Only in the candidate.")
    bitwise_equal: int = about("Every state of the trajectory is equal.")
    knife_edge: int = about("Counted separately, because a start 1e-6 away changes the label.")
    knife_edge_flipped: int = about("Number of these with another label.")


class ComparisonReport(Model):
    """The comparison of two stores."""

    schema_version: Literal[3] = 3
    verdict: Change
    exit_code: int
    headline: str
    baseline: ComparedStore | None = about("Null if it cannot be read.")
    candidate: ComparedStore | None = about("Null if it cannot be read.")
    control: ComparedStore | None = about(
        "A second store of the baseline, made the way the candidate was; null without one.",
        default=None,
    )
    match: Literal["id", "axes", "none"]
    judge: Literal["each", "spread"] = about(
        "Whether each pair of runs was judged, or all pairs together.", default="each"
    )
    model_changes: tuple[str, ...] = about(
        "Differences of the models in words, alike ones together; empty for equal models.",
        default=(),
    )
    pairs: PairCounts
    differences: tuple[Difference, ...]
    transitions: tuple[Transition, ...]
    findings: tuple[Finding, ...]
    advice: tuple[str, ...] = about("Commands to run next.")
