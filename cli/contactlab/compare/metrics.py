"""Metrics: one check for each, and for each of its groups."""

from collections.abc import Iterator

import numpy as np

from contactlab.compare.checks import Subject, skipped
from contactlab.compare.compared import Compared
from contactlab.compare.groups import groups
from contactlab.compare.rules import Rule, kind_of, rule_of
from contactlab.compare.sameness import difference
from contactlab.compare.series import Series
from contactlab.schema import Check
from contactlab.store import Measured


def metric_checks(compared: Compared) -> Iterator[Check]:
    """Yield the checks of every metric that the baseline or the candidate has."""
    measured = {**compared.candidate.columns.measured, **compared.baseline.columns.measured}
    for metric in measured.values():
        yield from _checks(compared, metric, rule_of(metric, compared.policy))


def _checks(compared: Compared, metric: Measured, rule: Rule) -> Iterator[Check]:
    told = list(groups(compared.baseline, compared.pairing, rule.by))
    if reason := _obstacle(compared, metric, rule):
        yield from (skipped(_subject(compared, metric, rule, group), reason) for group, _ in told)
        return
    whole = Series.of(compared, metric)
    for group, member in told:
        series = whole if member.all() else whole.at(np.flatnonzero(member))
        yield series.check(_subject(compared, metric, rule, group), rule)


def _obstacle(compared: Compared, metric: Measured, rule: Rule) -> str | None:
    """Return why a metric cannot be compared at all."""
    if metric.name not in compared.baseline.columns.measured:
        return "the baseline was made before there was this metric"
    sides = (compared.baseline, compared.candidate)
    before, after = (side.manifest.sweep.metric_versions.get(metric.name) for side in sides)
    required = "metric_versions" in compared.policy.require.same
    if required and None not in (before, after) and before != after:
        return f"its definition changed from version {before} to {after}"
    for what in rule.needs_same:
        if told := difference(compared.baseline, compared.candidate, what):
            return f"{what} differs: {told[0]}, now {told[1]}"
    return None


def _subject(compared: Compared, metric: Measured, rule: Rule, group: str) -> Subject:
    known = metric.name in compared.baseline.columns.measured
    return Subject(
        name=f"{metric.name} {'unchanged' if rule.better == 'none' else 'no worse'}",
        kind=kind_of(metric.name),
        level=rule.level if known else "note",
        group=group,
        unit=metric.unit,
        budget=rule.budget,
        two_sided=rule.better == "none",
    )
