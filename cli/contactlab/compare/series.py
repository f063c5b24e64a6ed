"""The values of one metric in some pairs of runs, and the check that they make."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactlab.compare.checks import MOST_SHOWN, Subject, made
from contactlab.compare.compared import Compared
from contactlab.compare.rules import Rule
from contactlab.compare.values import allowed, gaps, judged, reduced
from contactlab.compare.verdicts import CHANGED, NAMES, SAME, WORSE, Verdicts, counted
from contactlab.compare.wording import change, of, share
from contactlab.schema import Check, RunPair, Verdict
from contactlab.store import Measured, Numbers

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
class Series:
    """The values of one metric.

    Attributes:
        compared: the stores.
        unit: the metric's unit.
        places: (n,) which of the pairs.
        baseline: their values (n,).
        candidate: their values (n,).
        exempt: (n,) of which a second pass looked at one run only; None for other metrics.
    """

    compared: Compared
    unit: str
    places: NDArray[np.intp]
    baseline: Numbers
    candidate: Numbers
    exempt: NDArray[np.bool_] | None

    @classmethod
    def of(cls, compared: Compared, metric: Measured) -> "Series":
        """Return a metric's values in all pairs."""
        baseline, candidate = compared.numbers(metric.name)
        places = np.arange(len(baseline.values))
        exempt = compared.unasked if metric.second_pass else None
        return cls(compared, metric.unit, places, baseline, candidate, exempt)

    def at(self, places: NDArray[np.intp]) -> "Series":
        """Return the values of some of the pairs."""
        return Series(
            self.compared,
            self.unit,
            self.places[places],
            self.baseline.at(places),
            self.candidate.at(places),
            None if self.exempt is None else self.exempt[places],
        )

    def check(self, subject: Subject, rule: Rule) -> Check:
        """Return what comes of judging these values by a rule."""
        verdicts = gaps(self.baseline, self.candidate, self.exempt)
        both = self.baseline.given & self.candidate.given & (verdicts == SAME)
        applies = both | (verdicts != SAME)
        if not applies.any():
            return made(subject, verdicts[:0], "applies to no run")
        if rule.statistic == "each":
            verdicts[both] = judged(rule, self.baseline.values[both], self.candidate.values[both])
            return self._of_each(subject, rule, verdicts, applies)
        return self._of_all(subject, rule, verdicts, both)

    def _of_each(
        self, subject: Subject, rule: Rule, verdicts: Verdicts, applies: NDArray[np.bool_]
    ) -> Check:
        told = _told(verdicts, int(applies.sum()))
        worst = self._worst(rule, verdicts)
        return made(subject, verdicts[applies], told or _within(rule), worst)

    def _of_all(
        self, subject: Subject, rule: Rule, verdicts: Verdicts, both: NDArray[np.bool_]
    ) -> Check:
        gone = verdicts != SAME
        runs = int((gone | both).sum())
        found = verdicts[gone]
        told = [_told(verdicts, runs)] if gone.any() else []
        if both.any():
            values = reduced(rule, self.baseline.values[both], self.candidate.values[both])
            verdict = judged(rule, *values)
            found = np.concatenate([found, verdict])
            told.insert(0, _statistic(rule, verdict, (values[0][0], values[1][0]), self.unit))
        return made(subject, found, "; ".join(told), self._worst(rule, verdicts), runs=runs)

    def _worst(self, rule: Rule, verdicts: Verdicts) -> list[RunPair]:
        """Return the pairs of the worst verdict that are farthest beyond the tolerance."""
        least = CHANGED if rule.better == "none" else WORSE
        shown = verdicts >= least if (verdicts >= least).any() else verdicts != SAME
        if not shown.any():
            return []
        baseline, candidate = self.baseline.values, self.candidate.values
        with np.errstate(all="ignore"):
            excess = np.abs(candidate - baseline) / allowed(rule, baseline)
        ordering = np.nan_to_num(excess / _EXACT, nan=0, posinf=0.5).clip(0, 0.5)
        score = np.where(shown, verdicts + ordering, 0)
        most = min(MOST_SHOWN, int(shown.sum()))
        picked = np.argpartition(-score, most - 1)[:most]
        picked = picked[np.argsort(-score[picked], kind="stable")]
        return self.compared.run_pairs(
            self.places[picked].tolist(),
            [_value(self.baseline, place) for place in picked.tolist()],
            [_value(self.candidate, place) for place in picked.tolist()],
        )


def _told(verdicts: Verdicts, total: int) -> str:
    """Return `2 of 6 runs worse, 4 better`, or nothing where all are the same."""
    counts = counted(verdicts)
    parts = [(counts[name], word) for name, word in _FOUND.items() if name in counts]
    first = [f"{of(count, total)} {word}" for count, word in parts[:1]]
    return ", ".join([*first, *(f"{count:,} {word}" for count, word in parts[1:])])


def _statistic(rule: Rule, verdict: Verdicts, values: tuple[float, float], unit: str) -> str:
    word = "median ratio" if rule.statistic == "ratio" else rule.statistic
    found = "" if verdict[0] == SAME else f", {NAMES[int(verdict[0])]}"
    if rule.statistic == "ratio":
        return f"{word} {values[1]:.3g}{found} ({_within(rule)})"
    return f"{word} {change(*values, unit)}{found} ({_within(rule)})"


def _within(rule: Rule) -> str:
    return f"within {share(rule.rel)}"


def _value(numbers: Numbers, place: int) -> float | str | None:
    if not numbers.given[place]:
        return None
    value = float(numbers.values[place])
    return value if np.isfinite(value) else str(value)
