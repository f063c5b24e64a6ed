"""Verdicts as numbers, so that a million of them are one array."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from contactlab.schema import Check, CheckKind, CheckOutcome, Level, RunPair, Verdict

Verdicts = NDArray[np.int8]

# The worse, the larger: a fold is a maximum.
NAMES: tuple[Verdict, ...] = ("same", "better", "changed", "worse", "missing", "not comparable")
SAME, BETTER, CHANGED, WORSE, MISSING, NOT_COMPARABLE = range(len(NAMES))
assert set(NAMES) == set(get_args(Verdict))


def verdict_counts(verdicts: Verdicts) -> dict[Verdict, int]:
    """Return how many have which verdict, without those that none has."""
    counts = np.bincount(verdicts, minlength=len(NAMES)).tolist()
    return {name: count for name, count in zip(NAMES, counts, strict=True) if count}


def worst_verdict(verdicts: Verdicts) -> Verdict:
    """Return the worst verdict; same if there is none."""
    return NAMES[int(verdicts.max())] if len(verdicts) else "same"


OUTCOMES: dict[Level, CheckOutcome] = {"gate": "failed", "warn": "warned", "note": "noted"}
MOST_SHOWN = 5


@dataclass(frozen=True)
class CheckSubject:
    """What a check is about.

    Attributes:
        name: the check's name, the same every time.
        kind: which part of the report it belongs to.
        level: what falling short means.
        group: axis values of its runs, or empty.
        unit: of its values.
        budget: share of the verdicts that may fall short, with a warning.
        two_sided: whether a change is as bad as the worse.
    """

    name: str
    kind: CheckKind
    level: Level
    group: str = ""
    unit: str = ""
    budget: float = 0.0
    two_sided: bool = False

    @property
    def failing(self) -> tuple[int, ...]:
        """The verdicts that fall short."""
        changed = (CHANGED,) if self.two_sided else ()
        return (*changed, WORSE, MISSING, NOT_COMPARABLE)


def make_check(
    subject: CheckSubject,
    verdicts: Verdicts,
    message: str,
    worst: Sequence[RunPair] = (),
    *,
    runs: int | None = None,
) -> Check:
    """Return the check that verdicts (n,) make.

    Args:
        subject: what it is about.
        verdicts: of runs, or of what else it judges.
        message: what was found.
        worst: the worst few pairs.
        runs: how many runs were judged, if not n.
    """
    counts = verdict_counts(verdicts)
    failing = sum(counts.get(NAMES[code], 0) for code in subject.failing)
    return Check(
        name=subject.name,
        kind=subject.kind,
        group=subject.group,
        level=subject.level,
        outcome=_outcome(subject, counts, failing, len(verdicts)),
        verdict=worst_verdict(verdicts),
        runs=len(verdicts) if runs is None else runs,
        failing=failing,
        counts=counts,
        message=message,
        unit=subject.unit,
        worst=tuple(worst[:MOST_SHOWN]),
    )


def skipped_check(subject: CheckSubject, reason: str) -> Check:
    """Return a check of what cannot be compared."""
    return Check(
        name=subject.name,
        kind=subject.kind,
        group=subject.group,
        level=subject.level,
        outcome="skipped",
        verdict="not comparable",
        runs=0,
        failing=0,
        counts={},
        message=reason,
        unit=subject.unit,
    )


def _outcome(
    subject: CheckSubject, counts: dict[Verdict, int], failing: int, judged: int
) -> CheckOutcome:
    broken = counts.get("not comparable", 0)
    if broken or failing > subject.budget * judged:
        return OUTCOMES[subject.level]
    if failing:
        return "noted" if subject.level == "note" else "warned"
    if counts.get("changed", 0):
        return "noted"
    return "noted" if counts.get(NAMES[BETTER], 0) else "passed"
