"""Times measured again, both stores' runs interleaved: the only times that may gate."""

import math
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from contactlab.comparison.checks import BETTER, SAME, WORSE, CheckSubject, format_percent, plural
from contactlab.comparison.pairing import PairedStores
from contactlab.comparison.policies import REMEASURED, effective_rule
from contactlab.schema.comparison_report import Check, RunPair
from contactlab.store.table_layout import REAL, Column

_CONFIDENCE = 0.95
_LEAST_TIME = 0.05
"""CPU time that each timing of a run takes at least [s]."""
_MOST_REPEATS = 200


class RunTimer(Protocol):
    """Times runs of one store."""

    engine: str
    """The version of MuJoCo that steps its runs, after its name."""
    timed_engines: frozenset[str]
    """The names of the engines whose runs can be timed."""

    def time(self, run: str, repeats: int) -> tuple[float, float]:
        """Return the CPU time of the steps that were taken of a run, and of one of them [s]."""
        ...


StartTimer = Callable[[Path], AbstractContextManager[RunTimer]]
"""Starts what times the runs of the store in a folder, for as long as the context lasts."""


@dataclass(frozen=True)
class Remeasure:
    """What to time again: so many pairs of runs, spread evenly over all."""

    runs: int
    baseline: StartTimer
    candidate: StartTimer


def remeasured_check(paired: PairedStores, request: Remeasure) -> Check:
    """Return whether the candidate's runs take longer, timed again on this machine, interleaved.

    The candidate is slower, or faster, only if the whole confidence interval of the median ratio
    is beyond the tolerance. A StoreError says that a run cannot be timed, a PolicyError that an
    interpreter cannot time runs.
    """
    metric = Column(REMEASURED, REAL, "1", "", "lower")
    rule = effective_rule(metric, paired.policy)
    subject = CheckSubject(f"{REMEASURED} no worse", "time", rule.level)
    old, new = paired.baseline.path, paired.candidate.path
    with request.baseline(old) as before, request.candidate(new) as after:
        sample = _sample(paired, request.runs, before.timed_engines & after.timed_engines)
        if not sample:
            return subject.skipped("no pair of runs that completed can be timed")
        pairs = paired.run_pairs(sample, [None] * len(sample), [None] * len(sample))
        times = [_time_pair(before, after, pair) for pair in pairs]
        engines = f"{before.engine}, now {after.engine}"
    ratios = [now / then for then, now in times]
    low, high = median_interval(ratios)
    code = WORSE if low > 1 + rule.rel else BETTER if high < 1 - rule.rel else SAME
    message = (
        f"median ratio {np.median(ratios):.3f}, {format_percent(_CONFIDENCE)} interval "
        f"{low:.3f} to {high:.3f} over {plural(len(ratios))} "
        f"(within {format_percent(rule.rel)}; {engines})"
    )
    worst = int(np.argmax(ratios))
    then, now = times[worst]
    shown = pairs[worst].model_copy(update={"baseline": then, "candidate": now})
    return subject.single(code, message, [shown] if code != SAME else [], runs=len(ratios))


def median_interval(values: Sequence[float]) -> tuple[float, float]:
    """Return a 95 % confidence interval of the median of the distribution of independent values.

    Its ends are the k-th sorted value from each end, with the largest k such that fewer than k of n
    fair coins show heads with a probability of at most 2.5 %. With five values or fewer it is their
    range, which covers less than 95 %.
    """
    ordered, n = sorted(values), len(values)
    chance, k = 0.0, 0
    while (chance := chance + math.comb(n, k) / 2**n) <= (1 - _CONFIDENCE) / 2:
        k += 1
    k = max(k, 1)
    return ordered[k - 1], ordered[n - k]


def _time_pair(before: RunTimer, after: RunTimer, pair: RunPair) -> tuple[float, float]:
    """Return the CPU time of a step of both runs [s]: the smaller of two, timed in order ABBA."""
    assert pair.baseline_run is not None
    assert pair.candidate_run is not None
    least = min(before.time(pair.baseline_run, 1)[0], after.time(pair.candidate_run, 1)[0])
    repeats = min(_MOST_REPEATS, max(1, math.ceil(_LEAST_TIME / max(least, 1e-9))))
    first = before.time(pair.baseline_run, repeats)[1]
    others = [after.time(pair.candidate_run, repeats)[1] for _ in range(2)]
    last = before.time(pair.baseline_run, repeats)[1]
    return min(first, last), min(others)


def _sample(paired: PairedStores, runs: int, engines: frozenset[str]) -> list[int]:
    """Return indices of pairs whose runs both completed and can be timed, spread evenly."""
    through = np.ones(len(paired.pairing.baseline), dtype=np.bool_)
    for store, own in paired.sides:
        for column, wanted in (("status", {"ok"}), ("engine_name", engines)):
            codes, words = store.columns.strings(column)
            through &= np.array([*(word in wanted for word in words), False])[codes[own]]
    good = np.flatnonzero(through)
    count = min(runs, len(good))
    return good[np.linspace(0, len(good) - 1, count).round().astype(int)].tolist()
