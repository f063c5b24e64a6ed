"""Policies: which rule holds for a metric, which failing checks are accepted, and their file."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TypeVar

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from contactlab.errors import PolicyError
from contactlab.measure import METRICS
from contactlab.plan.sweep_file import read_yaml_as
from contactlab.schema.comparison import (
    AcceptedCheck,
    CheckKind,
    ComparePolicy,
    ComparisonReport,
    JudgedCheck,
    Level,
    MetricRule,
    Sameness,
    Statistic,
)
from contactlab.store.atomic_files import atomic_write
from contactlab.store.table_layout import Column

REMEASURED = "remeasured_time"
_LEAST_METRIC_CHANGE = (
    1e-6  # allowed change of every metric in its own unit: about what noise makes of 0
)
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
_NEW_FILE = """\
# What `contactlab compare` accepts; see `contactlab schema policy`.
version: 1
"""


def check_names(policy: ComparePolicy, metrics: Iterable[str], labels: Iterable[str]) -> None:
    """Raise PolicyError if the policy names metrics or labels that the stores do not have."""
    ruled = [name for name in policy.metrics if not set(name) & _WILDCARDS]
    moved = [
        name for transition in policy.labels.allow for name in (transition.from_, transition.to)
    ]
    for what, kind, names, known in (
        ("has a rule for", "metric", ruled, [*metrics, REMEASURED]),
        ("allows a transition of", "label", moved, list(labels)),
    ):
        for name in names:
            message = f"the policy {what} '{name}', but the stores have no such {kind}"
            PolicyError.unless_known(name, known, message)


@dataclass(frozen=True)
class EffectiveRule:
    """How one metric is compared, after defaults and policy; see `MetricRule`."""

    better: str
    abs: float
    rel: float = 0.0
    statistic: Statistic = "each"
    by: tuple[str, ...] = ()
    budget: float = 0.0
    level: Level = "gate"
    needs_same: tuple[Sameness, ...] = ()


def effective_rule(metric: Column, policy: ComparePolicy) -> EffectiveRule:
    """Return how a metric is compared.

    Defaults, the metric's own rule and the policy are merged key by key; the closest pattern wins,
    and the policy if two are equally close.
    """
    effective = EffectiveRule(metric.better, max(_LEAST_METRIC_CHANGE, metric.resolution))
    declared = METRICS[metric.name].rule if metric.name in METRICS else None
    own = {metric.name: declared} if declared else {}
    rules = (*_DEFAULTS.items(), *own.items(), *policy.metrics.items())
    for pattern, rule in sorted(rules, key=lambda item: _specificity(item[0])):
        if fnmatchcase(metric.name, pattern):
            effective = replace(effective, **rule.model_dump(exclude_none=True))
    return effective


def _specificity(pattern: str) -> tuple[bool, int]:
    """Return a sort key that grows with how closely a pattern describes a name."""
    return not set(pattern) & _WILDCARDS, sum(sign not in _WILDCARDS for sign in pattern)


def kind_of(name: str) -> CheckKind:
    """Return whether a metric is measured by the clock or by the physics."""
    timed = [pattern for pattern, rule in _DEFAULTS.items() if rule is _TIME]
    return "time" if any(fnmatchcase(name, pattern) for pattern in timed) else "metrics"


def acceptance(
    report: ComparisonReport, name: str, reason: str, until: date | None
) -> list[AcceptedCheck]:
    """Return the entries that accept a failing check until a day, one for each group that fails.

    A PolicyError says that there is no such check, that it passed, or that no reason is given.
    """
    if not reason.strip():
        raise PolicyError('an accepted check needs a reason: --reason "..."')
    checks = [check for check in report.checks if check.name == name]
    names = [check.name for check in report.checks]
    PolicyError.unless_known(name, names, f"there is no check '{name}'")
    failing = [check for check in checks if check.outcome in _FAILING]
    if not failing:
        raise PolicyError(f"'{name}' did not fail ({checks[0].message}): nothing to accept")
    reason = reason.strip()
    return [
        AcceptedCheck(
            check=name, group=check.group or None, max=check.failing, reason=reason, until=until
        )
        for check in failing
    ]


def accept(path: Path, entries: Sequence[AcceptedCheck]) -> None:
    """Write entries into a policy file, whose comments stay; a missing file is created.

    An earlier entry of the same check and group is replaced. An OutputError says that the file
    cannot be written, a SweepFileError what is wrong with the one that is there.
    """
    if path.exists():
        read_yaml_as(path, ComparePolicy)
    yaml = YAML()
    yaml.preserve_quotes = True
    document = yaml.load(path.read_text(encoding="utf-8") if path.exists() else _NEW_FILE)
    listed = document.setdefault("accept", CommentedSeq())
    for entry in entries:
        named = (entry.check, entry.group)
        for old in [
            listed_entry
            for listed_entry in listed
            if (listed_entry["check"], listed_entry.get("group")) == named
        ]:
            listed.remove(old)
        listed.append(CommentedMap(entry.model_dump(exclude_none=True)))
    with atomic_write(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        yaml.dump(document, file)


_Check = TypeVar("_Check", bound=JudgedCheck)
_FAILING = {"failed", "warned"}


def apply_acceptances(
    checks: Sequence[_Check],
    accepted: Sequence[AcceptedCheck],
    today: date,
    known: Collection[str] = (),
) -> list[_Check]:
    """Return the checks; those that fail and are accepted become notes.

    Entries may also name checks that are known, but were not made this time; any other name is a
    PolicyError.
    """
    names = {*known, *(check.name for check in checks)}
    for entry in accepted:
        message = f"the policy accepts '{entry.check}', which is not a check"
        PolicyError.unless_known(entry.check, names, message)
    return [_accepted(check, accepted, today) for check in checks]


def stale_acceptances(
    checks: Sequence[JudgedCheck], accepted: Sequence[AcceptedCheck]
) -> list[AcceptedCheck]:
    """Return the entries whose check was made, and does not fail."""
    made = {check.name for check in checks if check.outcome != "skipped"}
    return [
        entry
        for entry in accepted
        if entry.check in made
        and not any(
            check.outcome in _FAILING or check.accepted for check in checks if _covers(entry, check)
        )
    ]


def _covers(entry: AcceptedCheck, check: JudgedCheck) -> bool:
    return entry.check == check.name and entry.group in {None, check.group}


def _accepted(check: _Check, entries: Sequence[AcceptedCheck], today: date) -> _Check:
    if check.outcome not in _FAILING:
        return check
    entry = next((accepted for accepted in entries if _covers(accepted, check)), None)
    if entry is None:
        return check
    if entry.until is not None and entry.until < today:
        obstacle = f"until {entry.until}"
    elif check.failing > entry.max:
        obstacle = f"for {entry.max:,}, but {check.failing:,} fall short"
    else:
        return check.model_copy(update={"outcome": "noted", "accepted": entry.reason})
    message = f"{check.message}; accepted {obstacle} ({entry.reason})"
    return check.model_copy(update={"message": message})
