"""Checks of runs and their labels, of expectations and of the recommendation."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from contactlab.comparison.judged_share import unless_unjudged
from contactlab.comparison.pairing import (
    PairedStores,
    Ranks,
    Rows,
    find_difference,
    for_both,
    group_pairs,
    unpaired_runs,
)
from contactlab.errors import ContactlabError
from contactlab.judge.subjects import (
    BETTER,
    CHANGED,
    MISSING,
    MOST_SHOWN,
    SAME,
    WORSE,
    Mask,
    Subject,
    Verdicts,
    verdict_counts,
)
from contactlab.judge.wording import format_settings, out_of, plural
from contactlab.judge.worst_runs import order_worst_first
from contactlab.pareto.analysis import analyze_tradeoff
from contactlab.rendering.amounts import format_percent
from contactlab.schema.comparison import AllowedTransition, Transition
from contactlab.schema.finding import Finding
from contactlab.schema.tradeoff_report import TradeoffReport
from contactlab.store.finished_store import Store


def unpaired_checks(paired: PairedStores) -> Iterator[Finding]:
    """Yield whether every run of one store is in the other: of the baseline, of the candidate."""
    missing, new = paired.pairing.missing, paired.pairing.new
    total = len(paired.pairing.baseline) + len(missing)
    verdicts = np.full(total, SAME, dtype=np.int8)
    verdicts[: len(missing)] = MISSING
    message = f"{out_of(len(missing), total)} not in the candidate"
    worst = unpaired_runs(paired.baseline, "baseline", missing[:MOST_SHOWN].tolist())
    subject = Subject("no missing runs", "runs", paired.policy.missing_runs)
    yield subject.make_finding(
        verdicts, message if len(missing) else f"all {total:,} are there", worst
    )
    verdicts = np.full(len(new), CHANGED, dtype=np.int8)
    message = f"{plural(len(new))} not in the baseline"
    worst = unpaired_runs(paired.candidate, "candidate", new[:MOST_SHOWN].tolist())
    subject = Subject("no new runs", "runs", paired.policy.new_runs, two_sided=True)
    yield subject.make_finding(verdicts, message if len(new) else "none", worst)


def knife_edge_check(paired: PairedStores) -> Finding:
    """Return whether few enough runs are on a knife edge."""
    rules = paired.policy.knife_edge
    subject = Subject("few knife-edge runs", "runs", rules.level)
    before, after = (int(flags.sum()) for flags in paired.knife_edges)
    flagged = paired.knife_edge
    total, excluded = len(flagged), int(flagged.sum()) if rules.exclude else 0
    too_many = after > max(rules.max_share * total, before)
    message = "not looked for"
    if any(store.manifest.sweep.resolved.get("knife_edge") for store, _ in paired.sides):
        allowed = format_percent(rules.max_share)
        message = f"{out_of(after, total)}, {before:,} in the baseline ({allowed} may be)"
        message += f"; {plural(excluded)} set apart" if excluded else ""
    return subject.make_single(WORSE if too_many else SAME, message, judged_count=total)


@dataclass(frozen=True)
class PairLabels:
    """The labels of all pairs; those of `ranks` are ordered worst first."""

    paired: PairedStores
    before: Ranks
    """(n,) index in `ranks` of the worst label in the baseline; `after` in the candidate."""
    after: Ranks
    gained: NDArray[np.int64]
    """(n,) bit i is set if label i of `ranks` is new; of `lost` if it is gone."""
    lost: NDArray[np.int64]
    is_allowed: Mask  # (n,) whether the policy allows the change
    notes: dict[str, str]  # why allowed transitions do not apply, by label

    @classmethod
    def from_pairs(cls, paired: PairedStores) -> "PairLabels":
        """Return the labels of all pairs, and the changes that the policy allows."""
        before, after = (paired.read_labels(store) for store, _ in paired.sides)
        old, new = (paired.label_sets(store) for store, _ in paired.sides)
        stable = np.int64(1) << (len(paired.ranks) - 1)
        allowed = np.zeros(len(before), dtype=np.bool_)
        notes: dict[str, str] = {}
        for entry in paired.policy.labels.allow:
            moved = before == paired.ranks.index(entry.from_)
            moved &= after == paired.ranks.index(entry.to)
            if obstacle := _find_obstacle(entry, int(moved.sum()), paired):
                notes[entry.to] = obstacle
            else:
                allowed |= moved
        gained, lost = new & ~old & ~stable, old & ~new & ~stable
        return cls(paired, before, after, gained, lost, allowed, notes)

    @cached_property
    def changed_labels(self) -> int:
        """Bit i is set if label i of `ranks` is new, or gone, in any pair."""
        return int(np.bitwise_or.reduce(self.gained) | np.bitwise_or.reduce(self.lost))

    @cached_property
    def verdicts(self) -> Verdicts:
        """The verdict on each pair (n,): by the worst label or, if equal, by the other labels."""
        equal = self.before == self.after
        worse = (self.after < self.before) | (equal & (self.gained != 0))
        better = (self.after > self.before) | (equal & (self.gained == 0) & (self.lost != 0))
        return np.where(worse, WORSE, np.where(better, BETTER, SAME)).astype(np.int8)

    def count_transitions(self) -> tuple[Transition, ...]:
        """Return the changes of worst labels with their numbers of runs, most frequent first."""
        ranks, moved = self.paired.ranks, self.before != self.after
        changes = np.stack([self.before[moved], self.after[moved]], axis=1)
        transitions, counts = np.unique(changes, axis=0, return_counts=True)
        pairs = zip(transitions.tolist(), counts.tolist(), strict=True)
        return tuple(
            Transition(
                baseline=ranks[before],
                candidate=ranks[after],
                runs=count,
                verdict="worse" if after < before else "better",
            )
            for (before, after), count in sorted(pairs, key=lambda pair: -pair[1])
        )


def label_checks(labels: PairLabels) -> Iterator[Finding]:
    """Yield for each label and group whether it is new in some runs."""
    paired, rules = labels.paired, labels.paired.policy.labels
    grouped = list(group_pairs(paired.baseline, paired.pairing, rules.by))
    thresholds = find_difference(paired.baseline, paired.candidate, "thresholds")
    if "thresholds" not in paired.policy.require.same:
        thresholds = None
    for rank, label in enumerate(paired.ranks[:-1]):
        for group, member in grouped:
            subject = Subject(f"no new {label}", "labels", rules.level, group)
            if thresholds:
                yield subject.make_skipped(
                    f"thresholds differ: {thresholds[0]}, now {thresholds[1]}"
                )
            else:
                yield _label_check(labels, subject, rank, np.flatnonzero(member))


def _label_check(labels: PairLabels, subject: Subject, rank: int, members: Rows) -> Finding:
    if not labels.changed_labels >> rank & 1:
        unchanged = np.full(len(members), SAME, dtype=np.int8)
        return subject.make_finding(unchanged, f"none in {plural(len(members))}")
    gained = labels.gained[members] >> rank & 1 == 1
    lost = labels.lost[members] >> rank & 1 == 1
    allowed, of_pair = labels.is_allowed[members], labels.verdicts[members]
    verdicts = np.full(len(members), SAME, dtype=np.int8)
    verdicts[lost & (of_pair == BETTER)] = BETTER
    verdicts[gained & ((of_pair != WORSE) | allowed)] = CHANGED
    verdicts[gained & (of_pair == WORSE) & ~allowed] = WORSE

    ranks, counts, runs = labels.paired.ranks, verdict_counts(verdicts), len(verdicts)
    label, permitted, parts = ranks[rank], int((gained & allowed).sum()), list[str]()
    if "worse" in counts:
        parts.append(f"{out_of(counts['worse'], runs)} newly {label}")
    if permitted:
        parts.append(f"{plural(permitted)} newly {label}, as the policy allows")
    if (others := counts.get("changed", 0) - permitted) > 0:
        parts.append(f"{plural(others)} newly {label}, but better on the whole")
    if "better" in counts:
        parts.append(f"{out_of(counts['better'], runs)} no longer {label}")
    if counts.keys() <= {"same"}:
        parts.append(f"none in {plural(runs)}")
    if label in labels.notes and gained.any():
        parts.append(labels.notes[label])

    shown_pairs = members[verdicts == verdicts.max(initial=SAME)] if verdicts.any() else members[:0]
    # The store with the label tells the worst of its runs.
    is_gone = verdicts.max(initial=SAME) == BETTER
    store, rows = labels.paired.sides[0 if is_gone else 1]
    shown_pairs = shown_pairs[order_worst_first(store, label, rows[shown_pairs])][:MOST_SHOWN]
    worst = labels.paired.run_pairs(
        shown_pairs.tolist(),
        [ranks[code] for code in labels.before[shown_pairs].tolist()],
        [ranks[code] for code in labels.after[shown_pairs].tolist()],
    )
    return subject.make_finding(verdicts, "; ".join(parts), worst)


def _find_obstacle(entry: AllowedTransition, runs: int, paired: PairedStores) -> str | None:
    """Return why an allowed transition does not apply; None if it does."""
    arrow = f"{entry.from_} -> {entry.to}"
    if entry.until is not None and entry.until < paired.today:
        return f"{arrow} was allowed until {entry.until} ({entry.reason})"
    if runs > entry.max:
        return f"{arrow} is allowed for {plural(entry.max)}, but {runs:,} do so ({entry.reason})"
    return None


def expectation_checks(paired: PairedStores) -> Iterator[Finding]:
    """Yield whether runs still meet the expectations, and the tolerances, of the sweep."""
    for column, name in (("expectation_met", "expectations"), ("tolerances_met", "tolerances")):
        before, after = paired.read_numbers(column)
        verdicts = np.full(len(before.values), SAME, dtype=np.int8)
        verdicts[(before.values == 1) & (after.values == 0)] = WORSE
        verdicts[(before.values == 0) & (after.values == 1)] = BETTER
        verdicts[(before.values == 1) & ~after.valid] = MISSING
        verdicts[~before.valid & (after.values == 0)] = CHANGED
        is_judged = before.valid | after.valid
        message = f"{out_of(int((after.values == 1).sum()), int(is_judged.sum()))} within {name}"
        if not is_judged.any():
            message = f"the sweep has no {name}"
            # Requirements are labels, which have checks of their own.
            if name == "expectations" and paired.candidate.manifest.sweep.resolved.get("must"):
                message = "the sweep has no `expect`; labels judge its `must`"
        shown_pairs = np.flatnonzero(verdicts == WORSE)[:MOST_SHOWN].tolist()
        worst = paired.run_pairs(
            shown_pairs, ["met"] * len(shown_pairs), ["not met"] * len(shown_pairs)
        )
        subject = Subject(f"{name} still met", "labels", paired.policy.expectations)
        finding = subject.make_finding(verdicts[is_judged], message, worst)
        unjudged = ~before.valid & (after.values == 0)
        yield unless_unjudged(paired, subject, finding, unjudged, after.valid)


# Stored times of two sessions on one idle machine differ by up to this fraction for no reason.
_LEAST_SAVING = 0.15


def recommendation_check(paired: PairedStores) -> Finding:
    """Return whether the recommendation of `contactlab tradeoff` for the baseline still holds.

    It holds while it is feasible in the candidate and no feasible configuration is clearly faster,
    both by the candidate's own times: by more than those of all configurations scatter between the
    stores.
    """
    level = paired.policy.recommendation.changed
    subject = Subject("same recommendation", "recommendation", level, two_sided=True)
    before, after = for_both(_analyze_store, (paired.baseline, paired.candidate))
    now = after.recommendation if after else None
    if before is None or after is None or before.recommendation is None:
        if now is None:
            return subject.make_single(SAME, "neither store recommends a configuration")
        return subject.make_single(BETTER, f"now recommends {format_settings(now.configuration)}")
    configuration = before.recommendation.configuration
    old = format_settings(configuration) or "the only configuration"
    if now is None:
        return subject.make_single(WORSE, f"{old} is not feasible any more, and nothing else is")

    new = format_settings(now.configuration)
    same = (each for each in after.configurations if each.configuration == configuration)
    evaluation = next(same, None)
    if evaluation is None or not evaluation.feasible or evaluation.time is None:
        return subject.make_single(WORSE, f"{old} is not feasible any more; now recommends {new}")
    saved = 1 - now.time / evaluation.time
    if saved > max(_LEAST_SAVING, 1 - math.exp(-_time_scatter(before, after))):
        saving_text = f"{new} takes {format_percent(saved)} less time than {old}"
        return subject.make_single(CHANGED, saving_text)
    return subject.make_single(SAME, old)


def _time_scatter(before: TradeoffReport, after: TradeoffReport) -> float:
    # How far the ratio of two times of one store moves by chance, as a logarithm. Busy machines
    # slow some configurations and not others, so the stores say it: by the median deviation of the
    # ratios of their times.
    earlier = {repr(each.configuration): each.time for each in before.configurations}
    shifts = [
        math.log(each.time / old)
        for each in after.configurations
        if each.time and (old := earlier.get(repr(each.configuration)))
    ]
    fewest_shifts = 4  # with fewer, the two that are compared decide the scatter
    if len(shifts) < fewest_shifts:
        return 0.0
    deviations = np.abs(np.array(shifts) - np.median(shifts))
    # 95 % of normal deviations lie within two standard deviations; a ratio has those of two times.
    deviation_of_median, covered_deviations = 1.4826, 2.0
    return covered_deviations * math.sqrt(2) * deviation_of_median * float(np.median(deviations))


def _analyze_store(store: Store) -> TradeoffReport | None:
    try:
        return analyze_tradeoff(store)
    except (ContactlabError, ValidationError):
        # No error was measured, or the sweep is of another version of contactlab.
        return None
