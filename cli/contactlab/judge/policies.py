"""Policies: which rule holds for a metric."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Literal

from contactlab.errors import PolicyError
from contactlab.judge.limits import Limit
from contactlab.measure import METRICS
from contactlab.schema.comparison import ComparePolicy, MetricRule, Sameness, Statistic
from contactlab.schema.finding import Level
from contactlab.store.table_layout import Column

REMEASURED = "remeasured_time"
_TIME = MetricRule(
    rel=0.15, statistic="ratio", budget=0.0, level="warn", needs_same=("cpu_model", "cpu_flags")
)
_DEFAULTS: Mapping[str, MetricRule] = {
    "*": MetricRule(rel=0.01, statistic="each", by=(), budget=0.02, level="gate", needs_same=()),
    "work_*": MetricRule(statistic="mean", budget=0.0),
    "error_estimate": MetricRule(level="note"),
    "cost_*": _TIME,
    "time_*": _TIME,
    "step_p*": _TIME,
    "compile_time": _TIME,
    REMEASURED: MetricRule(rel=0.05, statistic="ratio", budget=0.0),
}
_WILDCARDS = set("*?[]!")


def check_names(policy: ComparePolicy, metrics: Iterable[str], labels: Iterable[str]) -> None:
    """Raise PolicyError if the policy names metrics or labels that are not in the stores."""
    exact_names = [name for name in policy.metrics if not set(name) & _WILDCARDS]
    moved = [
        name for transition in policy.labels.allow for name in (transition.from_, transition.to)
    ]
    for what, kind, names, known_names in (
        ("has a rule for", "metric", exact_names, [*metrics, REMEASURED]),
        ("allows a transition of", "label", moved, list(labels)),
    ):
        for name in names:
            message = f"the policy {what} '{name}', but the stores have no such {kind}"
            PolicyError.unless_known(name, known_names, message)


@dataclass(frozen=True)
class EffectiveRule:
    """Rule for one metric, after defaults and policy; see `MetricRule`."""

    better: str
    abs: float
    rel: float = 0.0
    statistic: Statistic = "each"
    by: tuple[str, ...] = ()
    budget: float = 0.0
    level: Level = "gate"
    needs_same: tuple[Sameness, ...] = ()

    @property
    def limit(self) -> Limit:
        """The largest change, in the metric's unit."""
        return Limit("change", "", self.level, self.abs, relative=self.rel)


def effective_rule(metric: Column, policy: ComparePolicy) -> EffectiveRule:
    """Return the rule for a metric.

    Defaults, the metric's own rule and the policy are merged key by key; the closest pattern wins,
    and the policy if two are equally close.
    """
    least_change = 1e-6  # allowed change of every metric in its own unit: about the noise of 0
    effective = EffectiveRule(metric.better, max(least_change, metric.resolution))
    declared = METRICS[metric.name].rule if metric.name in METRICS else None
    own = {metric.name: declared} if declared else {}
    rules = (*_DEFAULTS.items(), *own.items(), *policy.metrics.items())
    for pattern, rule in sorted(rules, key=lambda item: _rank_pattern(item[0])):
        if fnmatchcase(metric.name, pattern):
            effective = replace(effective, **rule.model_dump(exclude_none=True))
    return effective


def _rank_pattern(pattern: str) -> tuple[bool, int]:
    """Return a sort key that grows with how closely a pattern describes a name."""
    return not set(pattern) & _WILDCARDS, sum(sign not in _WILDCARDS for sign in pattern)


def kind_of(name: str) -> Literal["time", "metrics"]:
    """Return whether a metric is measured by the clock or by the physics."""
    time_patterns = [pattern for pattern, rule in _DEFAULTS.items() if rule is _TIME]
    return "time" if any(fnmatchcase(name, pattern) for pattern in time_patterns) else "metrics"
