"""Checks of metrics, one for each and each of its groups, and of times that are measured again."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from itertools import chain, islice
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from contactlab.comparison.judged_share import unless_unjudged
from contactlab.comparison.pairing import PairedStores, Value, find_difference, group_pairs
from contactlab.contact.trace_arrays import Floats
from contactlab.judge.policies import REMEASURED, EffectiveRule, effective_rule, kind_of
from contactlab.judge.subjects import (
    BETTER,
    CHANGED,
    MISSING,
    MOST_SHOWN,
    NAMES,
    NOT_COMPARABLE,
    SAME,
    WORSE,
    Mask,
    Subject,
    Verdicts,
    verdict_counts,
)
from contactlab.judge.wording import out_of, plural, value_change
from contactlab.rendering.amounts import format_percent
from contactlab.schema.finding import Finding, RunPair, Verdict
from contactlab.schema.time_ratio import TimeRatio
from contactlab.shares import SURE
from contactlab.store.run_columns import NumberColumn
from contactlab.store.table_layout import REAL, Column
from contactlab.timing.interleaved import time_round

_WORDS: Mapping[Verdict, str] = {
    "not comparable": "not a number",
    "missing": "without a value now",
    "worse": "worse",
    "changed": "changed",
    "better": "better",
}


def metric_checks(paired: PairedStores) -> Iterator[Finding]:
    """Yield the checks of every metric that the baseline or the candidate has.

    The pairs that they show are read at the end, all at once, since those of one metric lie in many
    parts of the tables.
    """
    findings, shown = list[Finding](), list[ShownPairs]()
    for finding, pairs in chain.from_iterable(_judge_metrics(paired)):
        findings.append(finding)
        shown.append(pairs)
    read = iter(
        paired.run_pairs(
            [index for pairs in shown for index in pairs.indices],
            [value for pairs in shown for value in pairs.baseline],
            [value for pairs in shown for value in pairs.candidate],
        )
    )
    for finding, pairs in zip(findings, shown, strict=True):
        yield finding.model_copy(update={"worst": (*islice(read, len(pairs.indices)),)})


class ShownPairs(NamedTuple):
    """The pairs of runs that a finding shows: index of each, and its values in both stores."""

    indices: Sequence[int] = ()
    baseline: Sequence[Value] = ()
    candidate: Sequence[Value] = ()


_JudgedMetric = list[tuple[Finding, ShownPairs]]
"""The findings of a metric, one for each group of runs, and the pairs that they show."""


def _judge_metrics(paired: PairedStores) -> Iterator[_JudgedMetric]:
    metric_columns = {
        **paired.candidate.columns.metric_columns,
        **paired.baseline.columns.metric_columns,
    }
    yield from paired.map_in_threads(partial(_judge_metric, paired), metric_columns.values())


def _judge_metric(paired: PairedStores, metric: Column) -> _JudgedMetric:
    versions = paired.baseline.manifest.sweep.metric_versions
    rule = effective_rule(metric, paired.policy)
    reason = explain_incomparable(paired, metric, rule)
    columns = None if reason else paired.read_numbers(metric.name)
    if columns and (reason := explain_contradiction(paired, metric, rule, columns)):
        columns = None
    # A table that lacks a metric which its sweep measured was edited.
    is_known = metric.name in {*paired.baseline.columns.metric_columns, *versions}
    exempt = paired.half_checked & metric.second_pass
    judged_groups = list[tuple[Finding, ShownPairs]]()
    for group, member in group_pairs(paired.baseline, paired.pairing, rule.by):
        subject = Subject(
            name=f"{metric.name} {'unchanged' if rule.better == 'none' else 'no worse'}",
            kind=kind_of(metric.name),
            level=rule.level if is_known else "note",
            group=group,
            unit=metric.unit,
            budget=rule.budget,
            two_sided=rule.better == "none",
        )
        if columns is None:
            judged_groups.append((subject.make_skipped(reason or ""), ShownPairs()))
            continue
        rows = slice(None) if member.all() else np.flatnonzero(member)
        before, after = (column.at(rows) for column in columns)
        of = range(len(member)) if isinstance(rows, slice) else rows.tolist()
        pairs = MetricPairs(of, before, after, exempt[rows])
        unjudged = after.valid & ~before.valid & ~pairs.exempt
        finding, shown = pairs.make_finding(subject, rule)
        judged = unless_unjudged(paired, subject, finding, unjudged, after.valid)
        judged_groups.append((judged, shown if judged is finding else ShownPairs()))
    return judged_groups


def explain_incomparable(paired: PairedStores, metric: Column, rule: EffectiveRule) -> str | None:
    """Return why a metric cannot be compared at all; None if it can."""
    if metric.name not in paired.baseline.columns.metric_columns:
        return "the baseline was made before there was this metric"
    versions = [store.manifest.sweep.metric_versions for store, _ in paired.sides]
    before, after = (version.get(metric.name) for version in versions)
    required = "metric_versions" in paired.policy.require.same
    if required and None not in (before, after) and before != after:
        return f"its definition changed from version {before} to {after}"
    for what in rule.needs_same:
        if values := find_difference(paired.baseline, paired.candidate, what):
            return f"{what} differs: {values[0]}, now {values[1]}"
    return None


def explain_contradiction(
    paired: PairedStores,
    metric: Column,
    rule: EffectiveRule,
    columns: tuple[NumberColumn, NumberColumn],
) -> str | None:
    """Return why the values of a metric contradict equal trajectories; None if they do not.

    A metric is a function of the trajectory and of the content, settings and seed that an id stands
    for. If the definitions and the engine are the same, too, runs that are equal bit for bit have
    equal values, unless a table was edited. Values measured by the clock differ in any case.
    """
    if kind_of(metric.name) == "time" or paired.policy.match != "id":
        return None
    before, after = columns
    # Few pairs, if any, are equal and have other values: only these are looked at closely.
    changed = np.flatnonzero(paired.bitwise_equal & (before.values != after.values))
    comparable = _select_comparable(paired, metric, columns, changed)
    changed = changed[comparable]
    if not len(changed) or any(
        find_difference(paired.baseline, paired.candidate, what)
        for what in ("metric_versions", "thresholds", "engine")
    ):
        return None
    old, new = before.values[changed], after.values[changed]
    beyond = int(np.count_nonzero(np.abs(new - old) > rule.limit.allow_change(old)))
    if not beyond:
        return None
    equal = np.flatnonzero(paired.bitwise_equal)
    judged = _select_comparable(paired, metric, columns, equal)
    runs = out_of(beyond, int(np.count_nonzero(judged)))
    return (
        f"{runs} with bitwise equal trajectories have other values: a table was edited, or the "
        "metric does not repeat; run contactlab verify --simulate on both stores"
    )


def _select_comparable(
    paired: PairedStores,
    metric: Column,
    columns: tuple[NumberColumn, NumberColumn],
    rows: NDArray[np.intp],
) -> Mask:
    # Return which of some pairs (m,) have two finite values that were measured alike.
    comparable = ~(paired.half_checked[rows] & metric.second_pass)
    for column in columns:
        comparable &= column.valid[rows] & np.isfinite(column.values[rows])
    return comparable


@dataclass(frozen=True)
class MetricPairs:
    """The values of one metric in n pairs of runs, by index (n,) of all pairs.

    In the exempt pairs (n,), only one run may have a value.
    """

    indices: Sequence[int]
    baseline: NumberColumn
    candidate: NumberColumn
    exempt: Mask

    def make_finding(self, subject: Subject, rule: EffectiveRule) -> tuple[Finding, ShownPairs]:
        """Return the finding that these values make by a rule, and the pairs that it shows."""
        verdicts = gap_verdicts(self.baseline, self.candidate, self.exempt)
        both = self.baseline.valid & self.candidate.valid
        applies = both
        if verdicts.any():
            both = both & (verdicts == SAME)
            applies = both | (verdicts != SAME)
        runs = int(np.count_nonzero(applies))
        if not runs:
            return subject.make_finding(verdicts[:0], "applies to no run"), ShownPairs()
        compared = slice(None) if both.all() else both
        before, after = self.baseline.values[compared], self.candidate.values[compared]
        if rule.statistic == "each":
            verdicts[compared] = judge_changes(rule, before, after)
            message = _format_counts(verdicts, runs) or f"within {format_percent(rule.rel)}"
            judged = verdicts if runs == len(verdicts) else verdicts[applies]
            return subject.make_finding(judged, message), self._find_worst(rule, verdicts)
        all_verdicts = verdicts[applies & ~both]
        parts = [_format_counts(verdicts, runs)] if len(all_verdicts) else []
        if both.any():
            statistic = aggregate_values(rule, before, after)
            verdict = judge_changes(rule, *statistic)
            all_verdicts = np.concatenate([all_verdicts, verdict])
            (old,), (new,) = statistic
            change = f"{rule.statistic} {value_change(old, new, subject.unit)}"
            change = f"median ratio {new:.3g}" if rule.statistic == "ratio" else change
            change += "" if verdict[0] == SAME else f", {NAMES[int(verdict[0])]}"
            parts.insert(0, f"{change} (tolerance {format_percent(rule.rel)})")
        finding = subject.make_finding(all_verdicts, "; ".join(parts), judged_count=runs)
        return finding, self._find_worst(rule, verdicts)

    def _find_worst(self, rule: EffectiveRule, verdicts: Verdicts) -> ShownPairs:
        """Return the pairs of the worst verdict that are farthest beyond the tolerance."""
        if not verdicts.any():
            return ShownPairs()
        least = CHANGED if rule.better == "none" else WORSE
        changed_rows = np.flatnonzero(verdicts >= least)
        changed_rows = changed_rows if len(changed_rows) else np.flatnonzero(verdicts)
        baseline, candidate = (
            self.baseline.values[changed_rows],
            self.candidate.values[changed_rows],
        )
        with np.errstate(all="ignore"):
            excess = np.abs(candidate - baseline) / rule.limit.allow_change(baseline)
        # Changes of more than half this number of tolerances are not ordered among each other.
        most_tolerances = 1e6
        # Less than 1, so that it only orders pairs of equal verdict.
        ordering = np.nan_to_num(excess / most_tolerances, nan=0, posinf=0.5).clip(0, 0.5)
        worst = changed_rows[
            np.argsort(-(verdicts[changed_rows] + ordering), kind="stable")[:MOST_SHOWN]
        ]
        return ShownPairs(
            [self.indices[place] for place in worst.tolist()],
            [_finite_value(self.baseline, index) for index in worst.tolist()],
            [_finite_value(self.candidate, index) for index in worst.tolist()],
        )


def judge_changes(rule: EffectiveRule, baseline: Floats, candidate: Floats) -> Verdicts:
    """Return the verdict on each pair of finite values (n,).

    A change is beyond tolerance if it is larger than `abs + rel * |baseline|`.
    """
    verdicts = np.full(len(baseline), SAME, np.int8)
    at_once = 1 << 14  # pairs: the intermediate arrays stay in the cache of a core
    for start in range(0, len(baseline), at_once):
        before = baseline[start : start + at_once]
        change = candidate[start : start + at_once] - before
        beyond = np.flatnonzero(np.abs(change) > rule.limit.allow_change(before))
        if not len(beyond):
            continue
        is_worse = change[beyond] < 0 if rule.better == "higher" else change[beyond] > 0
        changed = CHANGED if rule.better == "none" else np.where(is_worse, WORSE, BETTER)
        verdicts[start + beyond] = changed
    return verdicts


def gap_verdicts(baseline: NumberColumn, candidate: NumberColumn, exempt: Mask) -> Verdicts:
    """Return the verdict on pairs (n,) by missing, new and not finite values; otherwise the same.

    In `exempt` pairs (n,), only one run may have a value.
    """
    verdicts = np.zeros(len(baseline.values), dtype=np.int8)
    one = np.flatnonzero((baseline.valid != candidate.valid) & ~exempt)
    verdicts[one] = np.where(baseline.valid[one], MISSING, CHANGED)
    for store in (baseline, candidate):
        verdicts[np.flatnonzero(store.valid & ~np.isfinite(store.values))] = NOT_COMPARABLE
    return verdicts


def aggregate_values(
    rule: EffectiveRule, baseline: Floats, candidate: Floats
) -> tuple[Floats, Floats]:
    """Return the rule's statistic of both stores, (1,) each, from n > 0 pairs.

    For `ratio`: 1 and the median of candidate over baseline, where 0 / 0 counts as 1.
    """
    if rule.statistic == "ratio":
        with np.errstate(divide="ignore", invalid="ignore"):
            ratios = np.where(candidate == baseline, 1.0, candidate / baseline)
        return np.ones(1), np.array([np.median(ratios)])
    worst = np.min if rule.better == "higher" else np.max
    function = {"mean": np.mean, "median": np.median, "worst": worst}[rule.statistic]
    before, after = (
        np.array([function(metrics)], dtype=np.float64) for metrics in (baseline, candidate)
    )
    return before, after


def _format_counts(verdicts: Verdicts, total: int) -> str:
    """Return `2 of 6 runs worse, 4 better`; empty if all are the same."""
    counts = verdict_counts(verdicts)
    parts = [(counts[name], word) for name, word in _WORDS.items() if name in counts]
    first = [f"{out_of(count, total)} {word}" for count, word in parts[:1]]
    return ", ".join([*first, *(f"{count:,} {word}" for count, word in parts[1:])])


def _finite_value(column: NumberColumn, index: int) -> Value:
    if not column.valid[index]:
        return None
    value = float(column.values[index])
    return value if np.isfinite(value) else str(value)


class RunTimer(Protocol):
    """Times runs of one store."""

    engine: str  # the version of MuJoCo that steps its runs, after its name
    timed_engines: frozenset[str]  # names of the engines with runs that can be timed

    def time(self, run: str, repeats: int) -> tuple[float, float]:
        """Return the CPU time of the steps that were taken of a run, and of one of them [s]."""
        ...


StartTimer = Callable[[Path], AbstractContextManager[RunTimer]]
"""Starts what times the runs of the store in a folder, for as long as the context lasts."""


@dataclass(frozen=True)
class Remeasure:
    """Pairs of runs to time again: their number, spread evenly over all."""

    runs: int
    baseline: StartTimer
    candidate: StartTimer


def remeasured_check(paired: PairedStores, request: Remeasure) -> Finding:
    """Return whether the candidate's runs take longer, timed again on this machine, interleaved.

    The candidate is slower, or faster, only if the whole confidence interval of the median ratio
    is beyond the tolerance. A StoreError says that a run cannot be timed, a PolicyError that an
    interpreter cannot time runs.
    """
    metric = Column(REMEASURED, REAL, "1", "", "lower")
    rule = effective_rule(metric, paired.policy)
    subject = Subject(f"{REMEASURED} no worse", "time", rule.level)
    old, new = paired.baseline.path, paired.candidate.path
    with request.baseline(old) as before, request.candidate(new) as after:
        # Time pairs of runs that completed, spread evenly.
        through = np.ones(len(paired.pairing.baseline), dtype=np.bool_)
        for store, own in paired.sides:
            for column, allowed_words in (
                ("status", {"ok"}),
                ("engine_name", before.timed_engines & after.timed_engines),
            ):
                codes, words = store.columns.read_codes(column)
                through &= np.array([word in allowed_words for word in words])[codes[own]]
        good = np.flatnonzero(through)
        count = min(request.runs, len(good))
        sample = good[np.linspace(0, len(good) - 1, count).round().astype(int)].tolist()
        if not sample:
            return subject.make_skipped("no pair of runs that completed can be timed")
        pairs = paired.run_pairs(sample, [None] * len(sample), [None] * len(sample))
        times = [_time_pair(before, after, pair) for pair in pairs]
        engines = f"{before.engine}, now {after.engine}"
    ratios = [now / then for then, now in times]
    ratio = TimeRatio.of_pairs(ratios)
    worse, better = ratio.is_greater(1 + rule.rel), ratio.is_less(1 - rule.rel)
    code = WORSE if worse else BETTER if better else SAME
    message = (
        f"median ratio {ratio.ratio:.3f}, {format_percent(SURE)} interval "
        f"{ratio.low:.3f} to {ratio.high:.3f} over {plural(len(ratios))} "
        f"(tolerance {format_percent(rule.rel)}; {engines})"
    )
    worst = int(np.argmax(ratios))
    then, now = times[worst]
    worst_pair = pairs[worst].model_copy(update={"baseline": then, "candidate": now})
    return subject.make_single(
        code, message, [worst_pair] if code != SAME else [], judged_count=len(ratios)
    )


def _time_pair(before: RunTimer, after: RunTimer, pair: RunPair) -> tuple[float, float]:
    """Return the CPU time of a step of both runs [s], each timed twice in turns."""
    assert pair.baseline_run is not None
    assert pair.candidate_run is not None
    least = min(before.time(pair.baseline_run, 1)[0], after.time(pair.candidate_run, 1)[0])
    least_seconds = 0.05  # CPU time that each timing of a run takes at least [s]
    most_repeats = 200
    repeats = min(most_repeats, max(1, math.ceil(least_seconds / max(least, 1e-9))))
    one, other = time_round(
        [
            lambda: before.time(str(pair.baseline_run), repeats)[1],
            lambda: after.time(str(pair.candidate_run), repeats)[1],
        ]
    )
    return float(one), float(other)
