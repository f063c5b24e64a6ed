"""From verdicts to a check: budget, level, and what it means for the job."""

from collections.abc import Sequence
from dataclasses import dataclass

from contactlab.compare.verdicts import (
    BETTER,
    CHANGED,
    MISSING,
    NAMES,
    NOT_COMPARABLE,
    WORSE,
    Verdicts,
    counted,
    folded,
)
from contactlab.schema import Check, CheckKind, Level, Outcome, RunPair, Verdict

OUTCOMES: dict[Level, Outcome] = {"gate": "failed", "warn": "warned", "note": "noted"}
MOST_SHOWN = 5


@dataclass(frozen=True)
class Subject:
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


def made(
    subject: Subject,
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
    counts = counted(verdicts)
    failing = sum(counts.get(NAMES[code], 0) for code in subject.failing)
    return Check(
        name=subject.name,
        kind=subject.kind,
        group=subject.group,
        level=subject.level,
        outcome=_outcome(subject, counts, failing, len(verdicts)),
        verdict=folded(verdicts),
        runs=len(verdicts) if runs is None else runs,
        failing=failing,
        counts=counts,
        message=message,
        unit=subject.unit,
        worst=tuple(worst[:MOST_SHOWN]),
    )


def skipped(subject: Subject, reason: str) -> Check:
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


def _outcome(subject: Subject, counts: dict[Verdict, int], failing: int, judged: int) -> Outcome:
    broken = counts.get("not comparable", 0)
    if broken or failing > subject.budget * judged:
        return OUTCOMES[subject.level]
    if failing:
        return "noted" if subject.level == "note" else "warned"
    if counts.get("changed", 0):
        return "noted"
    return "noted" if counts.get(NAMES[BETTER], 0) else "passed"
