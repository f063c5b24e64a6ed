"""Checks of labels: which are new in which runs, and which changes the policy allows."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from contactlab.comparison.checks import (
    BETTER,
    CHANGED,
    MOST_SHOWN,
    NAMES,
    SAME,
    WORSE,
    CheckSubject,
    Verdicts,
    out_of,
    plural,
)
from contactlab.comparison.opened_stores import difference
from contactlab.comparison.pairing import PairedStores, groups
from contactlab.schema.compare_policy import AllowedTransition
from contactlab.schema.comparison_report import Check, Transition

BitSets = NDArray[np.int64]


@dataclass(frozen=True)
class PairLabels:
    """The labels of all pairs; those of `ranks` are ordered worst first.

    Attributes:
        before: (n,) index in `ranks` of the worst label in the baseline.
        after: (n,) the same in the candidate.
        gained: (n,) bit i is set if label i of `ranks` is new.
        lost: (n,) bit i is set if it is gone.
        allowed: (n,) whether the policy allows the change.
        notes: why allowed transitions do not apply, by label.
    """

    paired: PairedStores
    before: NDArray[np.int64]
    after: NDArray[np.int64]
    gained: BitSets
    lost: BitSets
    allowed: NDArray[np.bool_]
    notes: dict[str, str]

    @classmethod
    def of(cls, paired: PairedStores) -> "PairLabels":
        """Return the labels of all pairs, and what the policy allows of their changes."""
        stores = (paired.baseline, paired.candidate)
        before, after = (paired.labels(each) for each in stores)
        old, new = (paired.label_sets(each) for each in stores)
        stable = np.int64(1) << (len(paired.ranks) - 1)
        allowed = np.zeros(len(before), dtype=np.bool_)
        notes: dict[str, str] = {}
        for entry in paired.policy.labels.allow:
            moved = before == paired.ranks.index(entry.from_)
            moved &= after == paired.ranks.index(entry.to)
            if obstacle := _obstacle(entry, int(moved.sum()), paired):
                notes[entry.to] = obstacle
            else:
                allowed |= moved
        return cls(
            paired, before, after, new & ~old & ~stable, old & ~new & ~stable, allowed, notes
        )

    @cached_property
    def verdicts(self) -> Verdicts:
        """The verdict on each pair (n,): by the worst label or, if equal, by the other labels."""
        equal = self.before == self.after
        worse = (self.after < self.before) | (equal & (self.gained != 0))
        better = (self.after > self.before) | (equal & (self.gained == 0) & (self.lost != 0))
        return np.where(worse, WORSE, np.where(better, BETTER, SAME)).astype(np.int8)

    def transitions(self) -> tuple[Transition, ...]:
        """Return how many runs changed from which worst label to which, most frequent first."""
        ranks, moved = self.paired.ranks, self.before != self.after
        changes = np.stack([self.before[moved], self.after[moved]], axis=1)
        found, counts = np.unique(changes, axis=0, return_counts=True)
        pairs = zip(found.tolist(), counts.tolist(), strict=True)
        return tuple(
            Transition(
                baseline=ranks[before],
                candidate=ranks[after],
                runs=count,
                verdict="worse" if after < before else "better",
            )
            for (before, after), count in sorted(pairs, key=lambda pair: -pair[1])
        )


def label_checks(labels: PairLabels) -> Iterator[Check]:
    """Yield for each label and group whether it is new in some runs."""
    paired, rules = labels.paired, labels.paired.policy.labels
    grouped = list(groups(paired.baseline, paired.pairing, rules.by))
    thresholds = difference(paired.baseline, paired.candidate, "thresholds")
    if "thresholds" not in paired.policy.require.same:
        thresholds = None
    for rank, label in enumerate(paired.ranks[:-1]):
        for group, member in grouped:
            subject = CheckSubject(f"no new {label}", "labels", rules.level, group)
            if thresholds:
                yield subject.skipped(f"thresholds differ: {thresholds[0]}, now {thresholds[1]}")
            else:
                yield _check(labels, subject, rank, np.flatnonzero(member))


def _check(
    labels: PairLabels, subject: CheckSubject, rank: int, members: NDArray[np.intp]
) -> Check:
    """Return whether label `rank` is new in some of the pairs with indices `members`."""
    gained = labels.gained[members] >> rank & 1 == 1
    lost = labels.lost[members] >> rank & 1 == 1
    allowed, of_pair = labels.allowed[members], labels.verdicts[members]
    verdicts = np.full(len(members), SAME, dtype=np.int8)
    verdicts[lost & (of_pair == BETTER)] = BETTER
    verdicts[gained & ((of_pair != WORSE) | allowed)] = CHANGED
    verdicts[gained & (of_pair == WORSE) & ~allowed] = WORSE
    ranks = labels.paired.ranks
    parts = list(_counts(verdicts, ranks[rank], int((gained & allowed).sum())))
    if ranks[rank] in labels.notes and gained.any():
        parts.append(labels.notes[ranks[rank]])
    shown = members[np.flatnonzero(verdicts == verdicts.max(initial=SAME))[:MOST_SHOWN]]
    shown = shown if verdicts.any() else shown[:0]
    worst = labels.paired.run_pairs(
        shown.tolist(),
        [ranks[code] for code in labels.before[shown].tolist()],
        [ranks[code] for code in labels.after[shown].tolist()],
    )
    return subject.check(verdicts, "; ".join(parts), worst)


def _counts(verdicts: Verdicts, label: str, allowed: int) -> Iterator[str]:
    counts = np.bincount(verdicts, minlength=len(NAMES)).tolist()
    total = len(verdicts)
    if counts[WORSE]:
        yield f"{out_of(counts[WORSE], total)} newly {label}"
    if allowed:
        yield f"{plural(allowed)} newly {label}, as the policy allows"
    if counts[CHANGED] > allowed:
        yield f"{plural(counts[CHANGED] - allowed)} newly {label}, but better on the whole"
    if counts[BETTER]:
        yield f"{out_of(counts[BETTER], total)} no longer {label}"
    if not any(counts[BETTER:]):
        yield f"none in {plural(total)}"


def _obstacle(entry: AllowedTransition, runs: int, paired: PairedStores) -> str | None:
    """Return why an allowed transition does not apply; None if it does."""
    arrow = f"{entry.from_} -> {entry.to}"
    if entry.until is not None and entry.until < paired.today:
        return f"{arrow} was allowed until {entry.until} ({entry.reason})"
    if runs > entry.max:
        return f"{arrow} is allowed for {plural(entry.max)}, but {runs:,} do so ({entry.reason})"
    return None
