"""What the policy says of each metric: the closest rule wins, and the file over the defaults."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

from contactlab.errors import PolicyError, did_you_mean
from contactlab.schema import CheckKind, ComparePolicy, Level, MetricRule, Sameness, Statistic
from contactlab.store import Measured

_LEAST = 1e-6
"""Allowed change of every metric in its own unit, beside the share; about what noise does to 0."""
_PHYSICS = MetricRule(rel=0.01, statistic="each", by=(), budget=0.02, level="gate", needs_same=())
_WORK = MetricRule(statistic="mean", budget=0.0)
_TIME = MetricRule(
    rel=0.15, statistic="ratio", budget=0.0, level="warn", needs_same=("cpu_model", "cpu_flags")
)
REMEASURED = "remeasured_time"
DEFAULTS: Mapping[str, MetricRule] = {
    "*": _PHYSICS,
    "solver_iterations": _WORK,
    "solver_iterations_mean": MetricRule(rel=0.05, abs=0.05),
    "solver_iterations_max": MetricRule(rel=0.05, abs=1.0),
    "work_*": _WORK,
    "error_estimate": MetricRule(level="note"),
    "cost_*": _TIME,
    "time_*": _TIME,
    "step_p*": _TIME,
    "compile_time": _TIME,
    REMEASURED: MetricRule(rel=0.05, statistic="ratio", budget=0.0),
}
_WILD = set("*?[]!")
_TIMED = tuple(pattern for pattern, rule in DEFAULTS.items() if rule is _TIME)


@dataclass(frozen=True)
class Rule:
    """How one metric is compared; see `MetricRule`.

    Attributes:
        better: lower, higher or none.
        rel: allowed share of the baseline's value.
        abs: allowed change beside that, in the metric's unit.
        statistic: what is compared.
        by: axes whose values are judged by themselves.
        budget: share of the runs that may fall short.
        level: what falling short means.
        needs_same: what both stores must have in common.
    """

    better: str
    rel: float
    abs: float
    statistic: Statistic
    by: tuple[str, ...]
    budget: float
    level: Level
    needs_same: tuple[Sameness, ...]


def rule_of(metric: Measured, policy: ComparePolicy) -> Rule:
    """Return how a metric is compared."""
    said: dict[str, Any] = {"better": metric.better, "abs": max(_LEAST, metric.resolution)}
    rules = (*DEFAULTS.items(), *policy.metrics.items())
    for pattern, rule in sorted(rules, key=lambda each: _specificity(each[0])):
        if fnmatchcase(metric.name, pattern):
            said |= rule.model_dump(exclude_none=True)
    return Rule(**said)


def _specificity(pattern: str) -> tuple[bool, int]:
    """Return what grows with how closely a pattern describes a name."""
    wild = set(pattern) & _WILD
    return not wild, sum(sign not in _WILD for sign in pattern)


def kind_of(name: str) -> CheckKind:
    """Return whether a metric is of the clock or of the physics."""
    return "time" if any(fnmatchcase(name, pattern) for pattern in _TIMED) else "metrics"


def check_names(policy: ComparePolicy, metrics: Iterable[str], labels: Iterable[str]) -> None:
    """Check that the policy names metrics and labels that there are.

    Raises:
        PolicyError: it does not.
    """
    metrics, labels = [*metrics, REMEASURED], list(labels)
    for name in policy.metrics:
        if not set(name) & _WILD and name not in metrics:
            raise PolicyError(
                f"the policy has a rule for '{name}', but the stores have no such metric"
                f"{did_you_mean(name, metrics)}"
            )
    named = [name for each in policy.labels.allow for name in (each.from_, each.to)]
    for name in named:
        if name not in labels:
            raise PolicyError(
                f"the policy allows a transition of '{name}', but the stores have no such label"
                f"{did_you_mean(name, labels)}"
            )
