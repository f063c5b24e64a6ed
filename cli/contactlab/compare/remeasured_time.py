"""Times measured anew, both stores' runs in turns: the only times that may gate."""

import math
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from contactlab.compare.paired_stores import PairedStores
from contactlab.compare.policies import REMEASURED, tolerance_of
from contactlab.compare.verdicts import BETTER, SAME, WORSE, CheckSubject, make_check, skipped_check
from contactlab.compare.wording import format_percent, plural
from contactlab.schema import Check, RunPair
from contactlab.store import MeasuredColumn

_CONFIDENCE = 0.95
_LEAST = 0.05
"""CPU time that a run is timed for at least, each time [s]."""
_MOST_REPEATS = 200


class RunTimer(Protocol):
    """Times runs of one store."""

    @property
    def engine(self) -> str:
        """The engine that steps the runs, with its version."""
        ...

    def time(self, run: str, repeats: int) -> tuple[float, float]:
        """Return the CPU time of all steps that were made of a run, and of one of them [s]."""
        ...


StartTimer = Callable[[Path], AbstractContextManager[RunTimer]]
"""Starts what times the runs of the store in a folder, for as long as the context lasts."""


@dataclass(frozen=True)
class Remeasure:
    """What to time again.

    Attributes:
        runs: number of pairs of runs, spread evenly over all.
        baseline: starts what times the baseline's runs.
        candidate: starts what times the candidate's runs.
    """

    runs: int
    baseline: StartTimer
    candidate: StartTimer


def remeasured_check(compared: PairedStores, request: Remeasure) -> Check:
    """Return whether the candidate's runs take longer, timed in turns on this machine.

    The median ratio over the pairs has an interval; only if all of it is beyond the tolerance is
    the candidate slower, or faster.

    Raises:
        StoreError: a run cannot be timed.
        PolicyError: an interpreter cannot time runs.
    """
    rule = tolerance_of(
        MeasuredColumn(REMEASURED, "1", "lower", 0.0, second_pass=False), compared.policy
    )
    subject = CheckSubject(f"{REMEASURED} no worse", "time", rule.level)
    places = _sample(compared, request.runs)
    if not places:
        return skipped_check(subject, "no pair of runs went through in both stores")
    pairs = compared.run_pairs(places, [None] * len(places), [None] * len(places))
    old, new = compared.baseline.store.path, compared.candidate.store.path
    with request.baseline(old) as before, request.candidate(new) as after:
        found = [_timed(before, after, pair) for pair in pairs]
        engines = f"{before.engine}, now {after.engine}"
    ratios = [taken[1] / taken[0] for taken in found]
    low, high = median_interval(ratios)
    code = WORSE if low > 1 + rule.rel else BETTER if high < 1 - rule.rel else SAME
    text = (
        f"median ratio {np.median(ratios):.3f}, {format_percent(_CONFIDENCE)} interval "
        f"{low:.3f} to {high:.3f} over {plural(len(ratios))} "
        f"(within {format_percent(rule.rel)}; {engines})"
    )
    worst = max(zip(ratios, pairs, found, strict=True), key=lambda each: each[0])
    shown = worst[1].model_copy(update={"baseline": worst[2][0], "candidate": worst[2][1]})
    verdict = np.full(1, code, dtype=np.int8)
    return make_check(subject, verdict, text, [shown] if code != SAME else [], runs=len(ratios))


def median_interval(values: Sequence[float]) -> tuple[float, float]:
    """Return an interval that holds the median of what the values are drawn from.

    It lies between two of the sorted values, the k-th from each end, with the largest k such that
    fewer than k of n fair coins show heads with a chance of at most 2.5 %. That needs no more than
    that the values are independent; with five or fewer, it is their range, and holds less.
    """
    ordered, n = sorted(values), len(values)
    chance, k = 0.0, 0
    while (chance := chance + math.comb(n, k) / 2**n) <= (1 - _CONFIDENCE) / 2:
        k += 1
    k = max(k, 1)
    return ordered[k - 1], ordered[n - k]


def _timed(before: RunTimer, after: RunTimer, pair: RunPair) -> tuple[float, float]:
    """Return both sides' CPU time of a step [s]: the lesser of two, taken in turns ABBA."""
    assert pair.baseline_run is not None
    assert pair.candidate_run is not None
    least = min(before.time(pair.baseline_run, 1)[0], after.time(pair.candidate_run, 1)[0])
    repeats = min(_MOST_REPEATS, max(1, math.ceil(_LEAST / max(least, 1e-9))))
    first = before.time(pair.baseline_run, repeats)[1]
    others = [after.time(pair.candidate_run, repeats)[1] for _ in range(2)]
    last = before.time(pair.baseline_run, repeats)[1]
    return min(first, last), min(others)


def _sample(compared: PairedStores, runs: int) -> list[int]:
    """Return places of pairs of which both runs went through, spread evenly."""
    sides = (compared.baseline, compared.candidate)
    rows = (compared.pairing.baseline, compared.pairing.candidate)
    through = np.ones(len(rows[0]), dtype=np.bool_)
    for side, of_side in zip(sides, rows, strict=True):
        for column, wanted in (("status", "ok"), ("engine_name", "mujoco")):
            codes, words = side.columns.strings(column)
            fine = np.array([word == wanted for word in words] + [False])
            through &= fine[codes[of_side]]
    good = np.flatnonzero(through)
    count = min(runs, len(good))
    return good[np.linspace(0, len(good) - 1, count).round().astype(int)].tolist()
