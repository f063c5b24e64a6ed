"""The checks that verdicts make, and how their messages write numbers, counts and settings."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from contactlab.schema.comparison import Check, CheckKind, CheckOutcome, Level, RunPair, Verdict
from contactlab.schema.evidence import Setting

Verdicts = NDArray[np.int8]
Mask = NDArray[np.bool_]
Pairs = Sequence[RunPair]
# Ordered from good to bad, so that the worst of many is their maximum.
NAMES: tuple[Verdict, ...] = ("same", "better", "changed", "worse", "missing", "not comparable")
SAME, BETTER, CHANGED, WORSE, MISSING, NOT_COMPARABLE = range(len(NAMES))
assert set(NAMES) == set(get_args(Verdict))

MOST_SHOWN = 5
_OUTCOMES: dict[Level, CheckOutcome] = {"gate": "failed", "warn": "warned", "note": "noted"}


def verdict_counts(verdicts: Verdicts) -> dict[Verdict, int]:
    """Return the number of each verdict that occurs."""
    counts = [int(np.count_nonzero(verdicts == code)) for code in range(len(NAMES))]
    return {name: count for name, count in zip(NAMES, counts, strict=True) if count}


@dataclass(frozen=True)
class CheckSubject:
    """Subject of a check: its name is the same in every comparison.

    A fraction of the verdicts, the budget, may fail with a warning. Of a two-sided check any change
    fails, as of a metric without a better direction.
    """

    name: str
    kind: CheckKind
    level: Level
    group: str = ""
    unit: str = ""
    budget: float = 0.0
    two_sided: bool = False

    def check(
        self, verdicts: Verdicts, message: str, worst: Pairs = (), *, runs: int | None = None
    ) -> Check:
        """Return the check that verdicts (n,) make; `runs` is how many were judged, if not n.

        Of the worst pairs a few are kept.
        """
        counts = verdict_counts(verdicts)
        changed = (CHANGED,) if self.two_sided else ()
        failures = (*changed, WORSE, MISSING, NOT_COMPARABLE)
        failing = sum(counts.get(NAMES[code], 0) for code in failures)
        return Check(
            name=self.name,
            kind=self.kind,
            group=self.group,
            level=self.level,
            outcome=self._outcome(counts, failing, len(verdicts)),
            verdict=NAMES[int(verdicts.max(initial=SAME))],
            runs=len(verdicts) if runs is None else runs,
            failing=failing,
            counts=counts,
            message=message,
            unit=self.unit,
            worst=tuple(worst[:MOST_SHOWN]),
        )

    def single(self, code: int, message: str, worst: Pairs = (), *, runs: int = 0) -> Check:
        """Return the check that one verdict on both stores as a whole makes."""
        return self.check(np.full(1, code, dtype=np.int8), message, worst, runs=runs)

    def skipped(self, reason: str) -> Check:
        """Return the check of what cannot be compared."""
        none = self.check(np.zeros(0, dtype=np.int8), reason)
        return none.model_copy(update={"outcome": "skipped", "verdict": "not comparable"})

    def _outcome(self, counts: dict[Verdict, int], failing: int, judged: int) -> CheckOutcome:
        if "not comparable" in counts or failing > self.budget * judged:
            return _OUTCOMES[self.level]
        if failing:
            return "noted" if self.level == "note" else "warned"
        return "noted" if counts.keys() & {"changed", "better"} else "passed"


def format_number(value: float) -> str:
    """Return a number to four digits."""
    return f"{value:.4g}"


def value_change(baseline: float, candidate: float, unit: str) -> str:
    """Return `0.1 -> 0.12 m (+20 %)`: two values and their relative change."""
    shown = f"{format_number(baseline)} -> {format_number(candidate)}"
    if format_number(baseline) == format_number(candidate):
        shown = f"{baseline:.10g} -> {candidate:.10g}"
    named = shown if unit in {"", "1", "any"} else f"{shown} {unit}"
    if baseline <= 0 or not abs(candidate / baseline) < 1e3:
        return named
    return f"{named} ({format_percent(candidate / baseline - 1, signed=True)})"


def format_percent(value: float, *, signed: bool = False) -> str:
    """Return a fraction in percent, to two digits."""
    sign = "+" if signed else ""
    percent = 100 * value
    digits = f"{percent:{sign}.0f}" if abs(percent) >= 10 else f"{percent:{sign}.2g}"
    return f"{digits} %"


def out_of(count: int, total: int, noun: str = "run") -> str:
    """Return `2 of 6 runs`."""
    return f"{count:,} of {total:,} {noun}{'' if total == 1 else 's'}"


def plural(count: int, noun: str = "run") -> str:
    """Return `1 run` or `2 runs`."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


def format_settings(values: dict[str, Setting]) -> str:
    """Return axis values as `cone=elliptic direction=45`."""
    return " ".join(f"{name}={_setting(value)}" for name, value in values.items())


def _setting(value: Setting) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    return f"'{value}'" if isinstance(value, str) and " " in value else str(value)
