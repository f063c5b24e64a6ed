"""Policy files: read one, and add to it what is accepted."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, cast

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from contactlab.errors import PolicyError, did_you_mean
from contactlab.measure import METRICS
from contactlab.plan import read_yaml_as
from contactlab.schema import (
    AcceptedCheck,
    Check,
    CheckKind,
    ComparePolicy,
    ComparisonReport,
    Level,
    MetricRule,
    Sameness,
    Statistic,
)
from contactlab.store import MeasuredColumn, atomic_write

_NEW = """\
# What `contactlab compare` accepts; see `contactlab schema policy`.
version: 1
"""


def read_policy(path: Path) -> ComparePolicy:
    """Read a policy file.

    Raises:
        SweepFileError: it cannot be read, or holds mistakes, all of which are in the message.
    """
    return read_yaml_as(path, ComparePolicy)


def acceptance(
    report: ComparisonReport, name: str, reason: str, until: date | None
) -> list[AcceptedCheck]:
    """Return the entries that accept what a check found now, one for each group that fell short.

    Args:
        report: of a comparison.
        name: the check's name.
        reason: why it is fine.
        until: last day on which it is; without end if None.

    Raises:
        PolicyError: there is no such check, it passed, or no reason is given.
    """
    if not reason.strip():
        raise PolicyError('what is accepted needs a reason: --reason "..."')
    checks = [check for check in report.checks if check.name == name]
    if not checks:
        names = [check.name for check in report.checks]
        raise PolicyError(f"there is no check '{name}'{did_you_mean(name, names)}")
    short = [check for check in checks if check.outcome in {"failed", "warned"}]
    if not short:
        raise PolicyError(f"'{name}' did not fail ({checks[0].message}): nothing to accept")
    return [_entry(check, reason, until) for check in short]


def accept(path: Path, entries: list[AcceptedCheck]) -> None:
    """Write entries into a policy file, whose comments stay; it is made if there is none.

    An earlier entry of the same check and group is replaced.

    Raises:
        OutputError: the file cannot be written.
        SweepFileError: it cannot be read, or holds mistakes.
    """
    if path.exists():
        read_policy(path)
    yaml = YAML()
    yaml.preserve_quotes = True
    text = path.read_text(encoding="utf-8") if path.exists() else _NEW
    document = cast("CommentedMap", yaml.load(text))
    listed = document.setdefault("accept", CommentedSeq())
    for entry in entries:
        data = entry.model_dump(exclude_none=True)
        same = [place for place, each in enumerate(listed) if _is_same(each, data)]
        for place in reversed(same):
            del listed[place]
        listed.append(CommentedMap(data))
    with atomic_write(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        yaml.dump(document, file)


def _entry(check: Check, reason: str, until: date | None) -> AcceptedCheck:
    return AcceptedCheck(
        check=check.name,
        group=check.group or None,
        max=check.failing,
        reason=reason.strip(),
        until=until,
    )


def _is_same(one: dict[str, Any], other: dict[str, Any]) -> bool:
    return all(one.get(name) == other.get(name) for name in ("check", "group"))


_LEAST = 1e-6
"""Allowed change of every metric in its own unit, beside the share; about what noise does to 0."""
_PHYSICS = MetricRule(rel=0.01, statistic="each", by=(), budget=0.02, level="gate", needs_same=())
_WORK = MetricRule(statistic="mean", budget=0.0)
_TIME = MetricRule(
    rel=0.15, statistic="ratio", budget=0.0, level="warn", needs_same=("cpu_model", "cpu_flags")
)
REMEASURED = "remeasured_time"
_DEFAULTS: Mapping[str, MetricRule] = {
    "*": _PHYSICS,
    "work_*": _WORK,
    "error_estimate": MetricRule(level="note"),
    "cost_*": _TIME,
    "time_*": _TIME,
    "step_p*": _TIME,
    "compile_time": _TIME,
    REMEASURED: MetricRule(rel=0.05, statistic="ratio", budget=0.0),
}
_WILD = set("*?[]!")
_TIMED = tuple(pattern for pattern, rule in _DEFAULTS.items() if rule is _TIME)


@dataclass(frozen=True)
class MetricTolerance:
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


def tolerance_of(metric: MeasuredColumn, policy: ComparePolicy) -> MetricTolerance:
    """Return how a metric is compared."""
    said: dict[str, Any] = {"better": metric.better, "abs": max(_LEAST, metric.resolution)}
    declared = METRICS[metric.name].rule if metric.name in METRICS else None
    own = {metric.name: declared} if declared else {}
    rules = (*_DEFAULTS.items(), *own.items(), *policy.metrics.items())
    for pattern, rule in sorted(rules, key=lambda each: _specificity(each[0])):
        if fnmatchcase(metric.name, pattern):
            said |= rule.model_dump(exclude_none=True)
    return MetricTolerance(**said)


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


def apply_acceptances(
    checks: Sequence[Check], accepted: Iterable[AcceptedCheck], today: date
) -> list[Check]:
    """Return the checks, failed ones that an entry accepts being only told.

    Raises:
        PolicyError: an entry names a check that there is not.
    """
    names = {check.name for check in checks}
    entries = list(accepted)
    for entry in entries:
        if entry.check not in names:
            hint = did_you_mean(entry.check, names)
            raise PolicyError(f"the policy accepts '{entry.check}', which is no check{hint}")
    return [_judged(check, entries, today) for check in checks]


def _judged(check: Check, entries: Sequence[AcceptedCheck], today: date) -> Check:
    if check.outcome not in {"failed", "warned"}:
        return check
    for entry in entries:
        if entry.check == check.name and entry.group in {None, check.group}:
            if obstacle := _not_accepted(entry, check, today):
                return check.model_copy(update={"message": f"{check.message}; {obstacle}"})
            return check.model_copy(update={"outcome": "noted", "accepted": entry.reason})
    return check


def _not_accepted(entry: AcceptedCheck, check: Check, today: date) -> str | None:
    if entry.until is not None and entry.until < today:
        return f"accepted until {entry.until} ({entry.reason})"
    if check.failing > entry.max:
        return f"accepted for {entry.max:,}, but {check.failing:,} fall short ({entry.reason})"
    return None
