"""Findings, made from verdicts on pairs of runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from contactlab.schema.finding import Change, Finding, Level, Outcome, RunPair, Verdict

Verdicts = NDArray[np.int8]
Mask = NDArray[np.bool_]
Pairs = Sequence[RunPair]
# Ordered from good to bad, so that the worst of many is their maximum.
NAMES: tuple[Change, ...] = ("same", "better", "changed", "worse", "missing", "not comparable")
SAME, BETTER, CHANGED, WORSE, MISSING, NOT_COMPARABLE = range(len(NAMES))
assert set(NAMES) == set(get_args(Change))

MOST_SHOWN = 5
OUTCOMES: dict[Level, Outcome] = {"gate": "failed", "warn": "warned", "note": "noted"}


def verdict_counts(verdicts: Verdicts) -> dict[Verdict, int]:
    """Return the number of each verdict that occurs."""
    worst = int(verdicts.max(initial=SAME))
    counts = [int(np.count_nonzero(verdicts == code)) for code in range(SAME + 1, worst + 1)]
    counts.insert(0, len(verdicts) - sum(counts))
    return {name: count for name, count in zip(NAMES, counts, strict=False) if count}


@dataclass(frozen=True)
class Subject:
    """Subject of a finding: its name is the same in every report.

    A share of the verdicts, the budget, may fail with a warning. A two-sided subject fails on any
    change, such as a metric without a better direction.
    """

    name: str
    kind: str
    level: Level
    group: str = ""
    unit: str = ""
    budget: float = 0.0
    two_sided: bool = False

    def make_finding(
        self,
        verdicts: Verdicts,
        message: str,
        worst: Pairs = (),
        *,
        judged_count: int | None = None,
    ) -> Finding:
        """Return the finding that verdicts (n,) make; `judged_count` is their number, if not n.

        The finding has the first few of the worst pairs.
        """
        counts = verdict_counts(verdicts)
        changed = (CHANGED,) if self.two_sided else ()
        failures = (*changed, WORSE, MISSING, NOT_COMPARABLE)
        failing = sum(counts.get(NAMES[code], 0) for code in failures)
        return Finding(
            name=self.name,
            kind=self.kind,
            group=self.group,
            level=self.level,
            outcome=self._judge_counts(counts, failing, len(verdicts)),
            verdict=NAMES[int(verdicts.max(initial=SAME))],
            judged=len(verdicts) if judged_count is None else judged_count,
            failing=failing,
            counts=counts,
            message=message,
            unit=self.unit,
            worst=tuple(worst[:MOST_SHOWN]),
        )

    def make_single(
        self, code: int, message: str, worst: Pairs = (), *, judged_count: int = 0
    ) -> Finding:
        """Return the finding that one verdict on both stores as a whole makes."""
        return self.make_finding(
            np.full(1, code, dtype=np.int8), message, worst, judged_count=judged_count
        )

    def make_skipped(self, reason: str) -> Finding:
        """Return the finding of a comparison that was skipped."""
        none = self.make_finding(np.zeros(0, dtype=np.int8), reason)
        return none.model_copy(update={"outcome": "skipped", "verdict": "not comparable"})

    def _judge_counts(
        self, counts: Mapping[Verdict, int], failing: int, judged_count: int
    ) -> Outcome:
        if "not comparable" in counts or failing > self.budget * judged_count:
            return OUTCOMES[self.level]
        if failing:
            return "noted" if self.level == "note" else "warned"
        return "noted" if counts.keys() & {"changed", "better"} else "passed"
