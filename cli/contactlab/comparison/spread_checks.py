"""Checks of a changed model: changes in most pairs of runs, whichever runs these are.

After a contact, the motion of a robot amplifies any change, even one of rounding. A single run then
says nothing: its label may flip without a cause. An effect on all runs can be shown.
"""

import math
from collections.abc import Iterator
from functools import partial
from itertools import chain

import numpy as np

from contactlab.comparison.judged_share import unless_unjudged
from contactlab.comparison.metric_checks import explain_contradiction, explain_incomparable
from contactlab.comparison.pairing import PairedStores, group_pairs
from contactlab.comparison.run_checks import PairLabels
from contactlab.contact.trace_arrays import Floats
from contactlab.judge.policies import EffectiveRule, effective_rule, kind_of
from contactlab.judge.subjects import BETTER, CHANGED, MISSING, SAME, WORSE, Mask, Subject
from contactlab.judge.wording import format_change, out_of, plural
from contactlab.rendering.amounts import format_percent
from contactlab.schema.finding import Finding
from contactlab.shares import SURE, median_interval, paired_chance, paired_difference
from contactlab.store.run_columns import NumberColumn
from contactlab.store.table_layout import Column


def pairs_to_tell(metrics: int) -> int:
    """Return the number of pairs that some metrics need to show a change of all of them."""
    return _pairs_for(_sure_of_each(metrics))


def _sure_of_each(metrics: int) -> float:
    # So that all metrics together raise a false alarm in one comparison of twenty.
    return 1 - (1 - SURE) / max(1, metrics)


def _pairs_for(sure: float) -> int:
    # By chance, all of n changes have one sign with a probability of 2 / 2^n.
    return math.ceil(math.log2(2 / (1 - sure)))


def spread_label_checks(labels: PairLabels) -> Iterator[Finding]:
    """Yield for each label and group whether more runs have it than in the baseline."""
    paired, rules = labels.paired, labels.paired.policy.labels
    groups = list(group_pairs(paired.baseline, paired.pairing, rules.by))
    # A label that no pair gained or lost raises no alarm.
    sure = _sure_of_each(labels.changed_labels.bit_count() * len(groups))
    for rank, label in enumerate(paired.ranks[:-1]):
        gained = (labels.gained >> rank & 1 == 1) & ~labels.is_allowed
        lost = labels.lost >> rank & 1 == 1
        for group, whole in groups:
            member = paired.select_once(whole, gained, lost)
            subject = Subject(f"no more {label}", "labels", rules.level, group)
            changes = gained & member, lost & member
            yield _share_finding(subject, *changes, int(member.sum()), label, sure)


def spread_expectation_checks(paired: PairedStores) -> Iterator[Finding]:
    """Yield whether as many runs meet the expectations, and the tolerances, of the sweep."""
    for column, name in (("expectation_met", "expectations"), ("tolerances_met", "tolerances")):
        before, after = paired.read_numbers(column)
        both = before.valid & after.valid
        lost = both & (before.values == 1) & (after.values == 0)
        gained = both & (before.values == 0) & (after.values == 1)
        subject = Subject(f"{name} still met", "labels", paired.policy.expectations)
        yield _share_finding(subject, lost, gained, int(both.sum()), f"outside {name}", SURE)


def _share_finding(
    subject: Subject, gained: Mask, lost: Mask, pairs: int, word: str, sure: float
) -> Finding:
    new, lost_count = int(gained.sum()), int(lost.sum())
    if not new and not lost_count:
        return subject.make_single(SAME, f"as often in {plural(pairs)}", judged_count=pairs)
    message = f"{out_of(new, pairs)} newly {word}, {lost_count:,} no longer"
    # The interval of the difference is too narrow where few pairs changed; the test is exact.
    if _are_more(new, lost_count, sure) or _are_more(lost_count, new, sure):
        low, high = paired_difference(new, lost_count, pairs)
        ends = (format_percent(end, signed=True) for end in (low, high))
        message += f": {' to '.join(ends)} with {format_percent(SURE)}"
        code = WORSE if new > lost_count else BETTER
        return subject.make_single(code, message, judged_count=pairs)
    chance = format_percent(paired_chance(new, lost_count))
    message += f": chance alone makes numbers so unequal in {chance} of comparisons"
    return subject.make_single(SAME, message, judged_count=pairs)


def spread_metric_checks(paired: PairedStores) -> Iterator[Finding]:
    """Yield for every metric and group whether most runs are worse, beyond chance and tolerance."""
    metric_columns = {
        **paired.candidate.columns.metric_columns,
        **paired.baseline.columns.metric_columns,
    }

    def has_value(name: str) -> bool:
        return bool(paired.read_numbers(name)[1].valid.any())

    count = sum(paired.map_in_threads(has_value, metric_columns))
    judge = partial(_judge_spread, paired, _sure_of_each(count))
    yield from chain.from_iterable(paired.map_in_threads(judge, metric_columns.values()))


def _judge_spread(paired: PairedStores, sure: float, metric: Column) -> list[Finding]:
    rule = effective_rule(metric, paired.policy)
    columns = paired.read_numbers(metric.name)
    reason = explain_incomparable(paired, metric, rule)
    reason = reason or explain_contradiction(paired, metric, rule, columns)
    findings = list[Finding]()
    for group, member in group_pairs(paired.baseline, paired.pairing, rule.by):
        unchanged = rule.better == "none"
        subject = Subject(
            name=f"{metric.name} {'unchanged' if unchanged else 'no worse'}",
            kind=kind_of(metric.name),
            level=rule.level,
            group=group,
            unit=metric.unit,
            two_sided=unchanged,
        )
        if reason:
            findings.append(subject.make_skipped(reason))
            continue
        rows = np.flatnonzero(paired.select_once(member, *(column.values for column in columns)))
        before, after = (column.at(rows) for column in columns)
        finding = spread_finding(subject, rule, before, after, sure)
        new, is_gone = after.valid & ~before.valid, before.valid & ~after.valid
        if _are_more(int(new.sum()), int(is_gone.sum()), sure):
            finding = unless_unjudged(paired, subject, finding, new, after.valid)
        findings.append(finding)
    return findings


def _are_more(some: int, others: int, sure: float) -> bool:
    # Whether chance hardly explains that more pairs are of the first kind than of the second.
    return some > others and paired_chance(some, others) <= 1 - sure


def spread_finding(
    subject: Subject, rule: EffectiveRule, before: NumberColumn, after: NumberColumn, sure: float
) -> Finding:
    """Return whether the median change of the pairs that changed is beyond tolerance and chance."""
    pairs = int((before.valid | after.valid).sum())
    if not pairs:
        return subject.make_single(SAME, "applies to no run")
    lost_count, new = (
        int((before.valid & ~after.valid).sum()),
        int((after.valid & ~before.valid).sum()),
    )
    if _are_more(lost_count, new, sure):
        return subject.make_single(
            MISSING, f"{out_of(lost_count, pairs)} without a value now", judged_count=pairs
        )
    both = before.valid & after.valid
    changed = _changed_pairs(before.values, after.values, rule) & both
    old_values, new_values = before.values[changed], after.values[changed]
    if not len(old_values):
        return subject.make_single(SAME, f"the same in {plural(pairs, 'pair')}", judged_count=pairs)
    # Changes for the worse, in tolerances and as shares of the baseline's value; of the candidate's
    # if that is 0. A value that is not finite is worse than any other.
    sign = -1.0 if rule.better == "higher" else 1.0
    with np.errstate(all="ignore"):
        change = new_values - old_values
        shares = change / np.where(old_values == 0, np.abs(new_values), np.abs(old_values))
        tolerances = sign * change / rule.limit.allow_change(old_values)
    lost, was_lost = ~np.isfinite(new_values), ~np.isfinite(old_values)
    tolerances = np.where(lost, np.inf, np.where(was_lost, -np.inf, tolerances))
    shares = np.nan_to_num(shares)
    low, high = median_interval(tolerances.tolist(), sure)
    enough = _pairs_for(sure)
    code = SAME
    if low > 1:
        code = CHANGED if rule.better == "none" else WORSE
    elif high < -1:
        code = CHANGED if rule.better == "none" else BETTER
    ends = [_share_text(end) for end in median_interval(shares.tolist(), sure)]
    middle = int(np.argsort(shares, kind="stable")[(len(shares) - 1) // 2])
    interval = "" if ends[0] == ends[1] else f" ({ends[0]} to {ends[1]})"
    example = format_change(float(old_values[middle]), float(new_values[middle]), subject.unit, 3)
    message = f"median change {_share_text(shares[middle])}{interval}, e.g. {example}"
    if len(shares) < pairs:
        message += f", in the {out_of(len(shares), pairs, 'pair')} that changed"
    message += (
        f", within {format_percent(rule.rel)}" if code == SAME and low > -1 and high < 1 else ""
    )
    if len(tolerances) < enough:
        code = SAME
        message += f"; {plural(enough, 'pair')} would tell, there are {len(tolerances)}"
    return subject.make_single(code, message, judged_count=pairs)


def _changed_pairs(before: Floats, after: Floats, rule: EffectiveRule) -> Mask:
    # As in any sign test, ties show no direction: runs without sliding would hide more friction in
    # all others, and so would those that differ by rounding, or by a tenth of the tolerance.
    tie = 0.1  # tolerances
    finite = np.isfinite(before), np.isfinite(after)
    with np.errstate(invalid="ignore"):
        moved = np.abs(after - before) > tie * rule.limit.allow_change(before)
        moved &= np.maximum(np.abs(before), np.abs(after)) > rule.abs
    return np.where(finite[0] & finite[1], moved, finite[0] != finite[1])


def _share_text(share: float) -> str:
    return format_percent(share, signed=True) if abs(share) < 1e3 else "to a thousandfold or more"
