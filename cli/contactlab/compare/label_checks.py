"""Labels: which are new, of which runs, and which of these changes the policy allows."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactlab.compare.opened_stores import difference
from contactlab.compare.paired_stores import PairedStores
from contactlab.compare.pairing import groups
from contactlab.compare.verdicts import (
    BETTER,
    CHANGED,
    MOST_SHOWN,
    NAMES,
    SAME,
    WORSE,
    CheckSubject,
    Verdicts,
    make_check,
    skipped_check,
)
from contactlab.compare.wording import out_of, plural
from contactlab.schema import AllowedTransition, Check, Transition

Masks = NDArray[np.int64]


@dataclass(frozen=True)
class PairLabels:
    """The labels of all pairs.

    Attributes:
        compared: the stores.
        before: (n,) place of the worst label in `ranks`, in the baseline.
        after: the same in the candidate.
        gained: (n,) bit i says that label i of `ranks` is new.
        lost: the same of those that are gone.
        excused: (n,) whether the policy allows the change.
        notes: what is to be said of allowed transitions, by label.
    """

    compared: PairedStores
    before: Masks
    after: Masks
    gained: Masks
    lost: Masks
    excused: NDArray[np.bool_]
    notes: dict[str, str]

    @classmethod
    def of(cls, compared: PairedStores) -> "PairLabels":
        """Return the labels of all pairs, with what the policy excuses."""
        sides = (compared.baseline, compared.candidate)
        before, after = (compared.labels(side) for side in sides)
        old, new = (compared.label_sets(side) for side in sides)
        stable = np.int64(1) << (len(compared.ranks) - 1)
        gained, lost = new & ~old & ~stable, old & ~new & ~stable
        excused = np.zeros(len(before), dtype=np.bool_)
        notes: dict[str, str] = {}
        for entry in compared.policy.labels.allow:
            moved = _moved(compared.ranks, before, after, entry)
            if obstacle := _obstacle(entry, int(moved.sum()), compared):
                notes[entry.to] = obstacle
            else:
                excused |= moved
        return cls(compared, before, after, gained, lost, excused, notes)

    @property
    def verdicts(self) -> Verdicts:
        """The verdict of every pair (n,): its worst label decides, then labels beside it."""
        level = self.before == self.after
        worse = (self.after < self.before) | (level & (self.gained != 0))
        better = (self.after > self.before) | (level & (self.gained == 0) & (self.lost != 0))
        return np.where(worse, WORSE, np.where(better, BETTER, SAME)).astype(np.int8)

    def transitions(self) -> tuple[Transition, ...]:
        """Return how many runs went from which worst label to which other, most first."""
        ranks, moved = self.compared.ranks, self.before != self.after
        codes = self.before[moved] * len(ranks) + self.after[moved]
        found, counts = np.unique(codes, return_counts=True)
        pairs = zip(found.tolist(), counts.tolist(), strict=True)
        return tuple(
            Transition(
                baseline=ranks[code // len(ranks)],
                candidate=ranks[code % len(ranks)],
                runs=count,
                verdict="worse" if code % len(ranks) < code // len(ranks) else "better",
            )
            for code, count in sorted(pairs, key=lambda pair: -pair[1])
        )


def label_checks(outcomes: PairLabels) -> Iterator[Check]:
    """Yield for each label and group whether it is new in some runs."""
    compared = outcomes.compared
    rules = compared.policy.labels
    told = list(groups(compared.baseline, compared.pairing, rules.by))
    thresholds = difference(compared.baseline, compared.candidate, "thresholds")
    required = "thresholds" in compared.policy.require.same
    verdicts = outcomes.verdicts
    for place, label in enumerate(compared.ranks[:-1]):
        for group, member in told:
            subject = CheckSubject(f"no new {label}", "labels", rules.level, group)
            if thresholds and required:
                yield skipped_check(
                    subject, f"thresholds differ: {thresholds[0]}, now {thresholds[1]}"
                )
            else:
                yield _check(outcomes, subject, place, np.flatnonzero(member), verdicts)


def _check(
    outcomes: PairLabels,
    subject: CheckSubject,
    place: int,
    members: NDArray[np.intp],
    whole: Verdicts,
) -> Check:
    gained = outcomes.gained[members] >> place & 1 == 1
    lost = outcomes.lost[members] >> place & 1 == 1
    excused, of_run = outcomes.excused[members], whole[members]
    verdicts = np.full(len(members), SAME, dtype=np.int8)
    verdicts[lost & (of_run == BETTER)] = BETTER
    verdicts[gained & ((of_run != WORSE) | excused)] = CHANGED
    verdicts[gained & (of_run == WORSE) & ~excused] = WORSE
    label = outcomes.compared.ranks[place]
    parts = list(_label_counts(verdicts, label, int((gained & excused).sum())))
    if label in outcomes.notes and gained.any():
        parts.append(outcomes.notes[label])
    shown = members[np.flatnonzero(verdicts == verdicts.max(initial=SAME))[:MOST_SHOWN]]
    shown = shown if verdicts.any() else shown[:0]
    ranks = outcomes.compared.ranks
    worst = outcomes.compared.run_pairs(
        shown.tolist(),
        [ranks[code] for code in outcomes.before[shown].tolist()],
        [ranks[code] for code in outcomes.after[shown].tolist()],
    )
    return make_check(subject, verdicts, "; ".join(parts), worst)


def _label_counts(verdicts: Verdicts, label: str, excused: int) -> Iterator[str]:
    counts = np.bincount(verdicts, minlength=len(NAMES)).tolist()
    total = len(verdicts)
    if counts[WORSE]:
        yield f"{out_of(counts[WORSE], total)} newly {label}"
    if excused:
        yield f"{plural(excused)} newly {label}, as the policy allows"
    if counts[CHANGED] > excused:
        yield f"{plural(counts[CHANGED] - excused)} newly {label}, but better on the whole"
    if counts[BETTER]:
        yield f"{out_of(counts[BETTER], total)} no longer {label}"
    if not any(counts[BETTER:]):
        yield f"none in {plural(total)}"


def _moved(
    ranks: Sequence[str], before: Masks, after: Masks, entry: AllowedTransition
) -> NDArray[np.bool_]:
    return (before == ranks.index(entry.from_)) & (after == ranks.index(entry.to))


def _obstacle(entry: AllowedTransition, runs: int, compared: PairedStores) -> str | None:
    """Return why an allowed transition excuses nothing; None if it does."""
    arrow = f"{entry.from_} -> {entry.to}"
    if entry.until is not None and entry.until < compared.today:
        return f"{arrow} was allowed until {entry.until} ({entry.reason})"
    if runs > entry.max:
        return f"{arrow} is allowed for {plural(entry.max)}, but {runs:,} do so ({entry.reason})"
    return None
