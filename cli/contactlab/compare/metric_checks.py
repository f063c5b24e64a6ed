"""Metrics: one check for each, and for each of its groups."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactlab.compare.opened_stores import difference
from contactlab.compare.paired_stores import PairedStores
from contactlab.compare.pairing import groups
from contactlab.compare.policies import MetricTolerance, kind_of, tolerance_of
from contactlab.compare.verdicts import (
    BETTER,
    CHANGED,
    MISSING,
    MOST_SHOWN,
    NAMES,
    NOT_COMPARABLE,
    SAME,
    WORSE,
    CheckSubject,
    Verdicts,
    make_check,
    skipped_check,
    verdict_counts,
)
from contactlab.compare.wording import format_percent, out_of, value_change
from contactlab.contact import Floats
from contactlab.schema import Check, RunPair, Verdict
from contactlab.store import MeasuredColumn, NumberColumn


def metric_checks(compared: PairedStores) -> Iterator[Check]:
    """Yield the checks of every metric that the baseline or the candidate has."""
    measured = {**compared.candidate.columns.measured, **compared.baseline.columns.measured}
    for metric in measured.values():
        yield from _checks(compared, metric, tolerance_of(metric, compared.policy))


def _checks(
    compared: PairedStores, metric: MeasuredColumn, rule: MetricTolerance
) -> Iterator[Check]:
    told = list(groups(compared.baseline, compared.pairing, rule.by))
    if reason := _not_comparable(compared, metric, rule):
        yield from (
            skipped_check(_subject(compared, metric, rule, group), reason) for group, _ in told
        )
        return
    whole = MetricPairs.of(compared, metric)
    for group, member in told:
        series = whole if member.all() else whole.at(np.flatnonzero(member))
        yield series.check(_subject(compared, metric, rule, group), rule)


def _not_comparable(
    compared: PairedStores, metric: MeasuredColumn, rule: MetricTolerance
) -> str | None:
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


def _subject(
    compared: PairedStores, metric: MeasuredColumn, rule: MetricTolerance, group: str
) -> CheckSubject:
    known = metric.name in compared.baseline.columns.measured
    return CheckSubject(
        name=f"{metric.name} {'unchanged' if rule.better == 'none' else 'no worse'}",
        kind=kind_of(metric.name),
        level=rule.level if known else "note",
        group=group,
        unit=metric.unit,
        budget=rule.budget,
        two_sided=rule.better == "none",
    )


_FOUND: Mapping[Verdict, str] = {
    "not comparable": "not a number",
    "missing": "without a value now",
    "worse": "worse",
    "changed": "changed",
    "better": "better",
}
_EXACT = 1e6
"""An excess over the tolerance, in its multiples, of twice this orders pairs no more."""


@dataclass(frozen=True)
class MetricPairs:
    """The values of one metric.

    Attributes:
        compared: the stores.
        unit: the metric's unit.
        places: (n,) which of the pairs.
        baseline: their values (n,).
        candidate: their values (n,).
        exempt: (n,) of which a second pass looked at one run only; None for other metrics.
    """

    compared: PairedStores
    unit: str
    places: NDArray[np.intp]
    baseline: NumberColumn
    candidate: NumberColumn
    exempt: NDArray[np.bool_] | None

    @classmethod
    def of(cls, compared: PairedStores, metric: MeasuredColumn) -> "MetricPairs":
        """Return a metric's values in all pairs."""
        baseline, candidate = compared.numbers(metric.name)
        places = np.arange(len(baseline.values))
        exempt = compared.unasked if metric.second_pass else None
        return cls(compared, metric.unit, places, baseline, candidate, exempt)

    def at(self, places: NDArray[np.intp]) -> "MetricPairs":
        """Return the values of some of the pairs."""
        return MetricPairs(
            self.compared,
            self.unit,
            self.places[places],
            self.baseline.at(places),
            self.candidate.at(places),
            None if self.exempt is None else self.exempt[places],
        )

    def check(self, subject: CheckSubject, rule: MetricTolerance) -> Check:
        """Return what comes of judging these values by a rule."""
        verdicts = value_gaps(self.baseline, self.candidate, self.exempt)
        both = self.baseline.valid & self.candidate.valid & (verdicts == SAME)
        applies = both | (verdicts != SAME)
        if not applies.any():
            return make_check(subject, verdicts[:0], "applies to no run")
        if rule.statistic == "each":
            verdicts[both] = judge(rule, self.baseline.values[both], self.candidate.values[both])
            return self._of_each(subject, rule, verdicts, applies)
        return self._of_all(subject, rule, verdicts, both)

    def _of_each(
        self,
        subject: CheckSubject,
        rule: MetricTolerance,
        verdicts: Verdicts,
        applies: NDArray[np.bool_],
    ) -> Check:
        told = _counts_text(verdicts, int(applies.sum()))
        worst = self._worst(rule, verdicts)
        return make_check(subject, verdicts[applies], told or _within(rule), worst)

    def _of_all(
        self,
        subject: CheckSubject,
        rule: MetricTolerance,
        verdicts: Verdicts,
        both: NDArray[np.bool_],
    ) -> Check:
        gone = verdicts != SAME
        runs = int((gone | both).sum())
        found = verdicts[gone]
        told = [_counts_text(verdicts, runs)] if gone.any() else []
        if both.any():
            values = aggregate(rule, self.baseline.values[both], self.candidate.values[both])
            verdict = judge(rule, *values)
            found = np.concatenate([found, verdict])
            told.insert(0, _statistic(rule, verdict, (values[0][0], values[1][0]), self.unit))
        return make_check(subject, found, "; ".join(told), self._worst(rule, verdicts), runs=runs)

    def _worst(self, rule: MetricTolerance, verdicts: Verdicts) -> list[RunPair]:
        """Return the pairs of the worst verdict that are farthest beyond the tolerance."""
        least = CHANGED if rule.better == "none" else WORSE
        shown = verdicts >= least if (verdicts >= least).any() else verdicts != SAME
        if not shown.any():
            return []
        baseline, candidate = self.baseline.values, self.candidate.values
        with np.errstate(all="ignore"):
            excess = np.abs(candidate - baseline) / allowed_change(rule, baseline)
        ordering = np.nan_to_num(excess / _EXACT, nan=0, posinf=0.5).clip(0, 0.5)
        score = np.where(shown, verdicts + ordering, 0)
        most = min(MOST_SHOWN, int(shown.sum()))
        picked = np.argpartition(-score, most - 1)[:most]
        picked = picked[np.argsort(-score[picked], kind="stable")]
        return self.compared.run_pairs(
            self.places[picked].tolist(),
            [_pair_value(self.baseline, place) for place in picked.tolist()],
            [_pair_value(self.candidate, place) for place in picked.tolist()],
        )


def _counts_text(verdicts: Verdicts, total: int) -> str:
    """Return `2 of 6 runs worse, 4 better`, or nothing where all are the same."""
    counts = verdict_counts(verdicts)
    parts = [(counts[name], word) for name, word in _FOUND.items() if name in counts]
    first = [f"{out_of(count, total)} {word}" for count, word in parts[:1]]
    return ", ".join([*first, *(f"{count:,} {word}" for count, word in parts[1:])])


def _statistic(
    rule: MetricTolerance, verdict: Verdicts, values: tuple[float, float], unit: str
) -> str:
    word = "median ratio" if rule.statistic == "ratio" else rule.statistic
    found = "" if verdict[0] == SAME else f", {NAMES[int(verdict[0])]}"
    if rule.statistic == "ratio":
        return f"{word} {values[1]:.3g}{found} ({_within(rule)})"
    return f"{word} {value_change(*values, unit)}{found} ({_within(rule)})"


def _within(rule: MetricTolerance) -> str:
    return f"within {format_percent(rule.rel)}"


def _pair_value(numbers: NumberColumn, place: int) -> float | str | None:
    if not numbers.valid[place]:
        return None
    value = float(numbers.values[place])
    return value if np.isfinite(value) else str(value)


_SIGN = {"lower": 1.0, "higher": -1.0, "none": 1.0}
_STATISTICS: Mapping[str, Callable[[Floats], np.float64]] = {
    "mean": lambda values: values.mean(),
    "median": np.median,
}


def judge(rule: MetricTolerance, baseline: Floats, candidate: Floats) -> Verdicts:
    """Return the verdict of each pair of finite values.

    A change is beyond tolerance if it is larger than `abs + rel * |baseline|`.
    """
    change = _SIGN[rule.better] * (candidate - baseline)
    beyond = np.abs(change) > allowed_change(rule, baseline)
    if rule.better == "none":
        return np.where(beyond, CHANGED, SAME).astype(np.int8)
    return np.where(beyond, np.where(change > 0, WORSE, BETTER), SAME).astype(np.int8)


def allowed_change(rule: MetricTolerance, baseline: Floats) -> Floats:
    """Return the largest change within tolerance, in the metric's unit."""
    return rule.abs + rule.rel * np.abs(baseline)


def value_gaps(
    baseline: NumberColumn, candidate: NumberColumn, exempt: NDArray[np.bool_] | None
) -> Verdicts:
    """Return the verdict of pairs of which a value is not there, or is no number; else same.

    Args:
        baseline: values (n,).
        candidate: values (n,).
        exempt: (n,) pairs of which one value was not asked for.
    """
    verdicts = np.zeros(len(baseline.values), dtype=np.int8)
    one = baseline.valid != candidate.valid
    if exempt is not None:
        one &= ~exempt
    verdicts[one & baseline.valid] = MISSING
    verdicts[one & candidate.valid] = CHANGED
    for side in (baseline, candidate):
        verdicts[side.valid & ~np.isfinite(side.values)] = NOT_COMPARABLE
    return verdicts


def aggregate(rule: MetricTolerance, baseline: Floats, candidate: Floats) -> tuple[Floats, Floats]:
    """Return the statistic of both sides, (1,) each, of pairs (n,) with n > 0.

    Of `ratio` these are 1 and the median over the pairs of candidate over baseline, 0 / 0 being 1.
    """
    if rule.statistic == "ratio":
        with np.errstate(divide="ignore", invalid="ignore"):
            ratios = np.where(candidate == baseline, 1.0, candidate / baseline)
        return np.ones(1), np.array([np.median(ratios)])
    if rule.statistic == "worst":
        pick = np.min if rule.better == "higher" else np.max
        return np.array([pick(baseline)]), np.array([pick(candidate)])
    statistic = _STATISTICS[rule.statistic]
    return np.array([statistic(baseline)]), np.array([statistic(candidate)])
