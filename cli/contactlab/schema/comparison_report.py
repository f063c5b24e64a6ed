"""The report of `contactlab compare`: checks with their verdicts."""

from typing import Literal

from contactlab.schema.compare_policy import JudgedCheck, Level
from contactlab.schema.evidence import Setting
from contactlab.schema.strict_model import Model, about

COMPARISON_VERSION = 1

Verdict = Literal["better", "same", "worse", "changed", "missing", "not comparable"]
CheckKind = Literal["evidence", "runs", "labels", "metrics", "time", "recommendation"]


class ComparedStore(Model):
    """One side of a comparison."""

    store: str
    sweep: str
    runs: int
    engine: str
    contactlab: str
    git_revision: str | None
    cpu_model: str
    finished: str


class Difference(Model):
    """Something in which the stores differ."""

    what: str
    baseline: str
    candidate: str
    required: bool = about("Whether the policy requires it to be the same.")


class RunPair(Model):
    """Two runs that were compared, or one without a counterpart."""

    baseline_run: str | None
    candidate_run: str | None
    axes: dict[str, Setting]
    baseline: float | str | None
    candidate: float | str | None


class Check(JudgedCheck):
    """One thing that was judged; the list of checks does not depend on their outcomes."""

    kind: CheckKind
    group: str = about("Axis values of its runs, such as cone=elliptic; or empty.")
    level: Level
    verdict: Verdict = about("Its result for the evidence.")
    runs: int = about("Runs, or groups of them, that were judged.")
    failing: int = about("How many of these fail.")
    counts: dict[Verdict, int] = about("How many have each verdict.")
    unit: str = ""
    accepted: str | None = about("Why the policy accepts it.", default=None)
    worst: tuple[RunPair, ...] = about("The worst few.", default=())

    @property
    def is_open(self) -> bool:
        """Whether it is a gate that could not be checked."""
        return self.outcome == "skipped" and self.level == "gate"


class Transition(Model):
    """Runs whose worst label changed."""

    baseline: str
    candidate: str
    runs: int
    verdict: Verdict


class PairCounts(Model):
    """How many runs there are, by how they were paired."""

    paired: int
    missing: int = about("Only in the baseline.")
    new: int = about("Only in the candidate.")
    bitwise_equal: int = about("Every state of the trajectory is equal.")
    knife_edge: int = about("Set apart, since a start 1e-6 away changes the label.")
    knife_edge_flipped: int = about("Of these, those whose label changed.")


class ComparisonReport(Model):
    """The comparison of two stores."""

    schema_version: Literal[1] = COMPARISON_VERSION
    verdict: Verdict
    exit_code: int
    headline: str
    baseline: ComparedStore | None = about("Null if it cannot be read.")
    candidate: ComparedStore | None = about("Null if it cannot be read.")
    match: Literal["id", "axes"]
    pairs: PairCounts
    differences: tuple[Difference, ...]
    transitions: tuple[Transition, ...]
    checks: tuple[Check, ...]
    advice: tuple[str, ...] = about("Commands to run next.")
