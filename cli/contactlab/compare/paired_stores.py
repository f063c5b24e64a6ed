"""What is compared: both stores, the pairs of their runs, and the policy."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import date
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from contactlab.compare.opened_stores import OpenedStore
from contactlab.compare.pairing import Pairing
from contactlab.schema import ComparePolicy, RunPair, Setting
from contactlab.store import NumberColumn

Value = float | str | None


@dataclass(frozen=True)
class PairedStores:
    """Two stores and how their runs belong together.

    Attributes:
        baseline: what is known.
        candidate: what is judged.
        pairing: the pairs of runs.
        policy: what is worse.
        today: the day that expiry dates are held against.
    """

    baseline: OpenedStore
    candidate: OpenedStore
    pairing: Pairing
    policy: ComparePolicy
    today: date

    def without(self, apart: NDArray[np.bool_]) -> "PairedStores":
        """Return the same without some of the pairs (n,)."""
        return replace(self, pairing=self.pairing.where(~apart)) if apart.any() else self

    def numbers(self, name: str) -> tuple[NumberColumn, NumberColumn]:
        """Return a column of both stores, pair by pair; empty where a store has no such column."""
        baseline, candidate = (
            self._numbers(self.baseline, name),
            self._numbers(self.candidate, name),
        )
        return baseline, candidate

    def _numbers(self, side: OpenedStore, name: str) -> NumberColumn:
        rows = self._rows(side)
        if name in side.columns.schema.names:
            return _taken(side.columns.numbers(name), rows)
        return NumberColumn(np.full(len(rows), np.nan), np.zeros(len(rows), dtype=np.bool_))

    @cached_property
    def ranks(self) -> "tuple[str, ...]":
        """All labels, worst first: the policy's order, or the one that the stores tell.

        Labels that the order does not name are taken for the worst.
        """
        sides = (self.candidate, self.baseline)
        told = [str(name) for side in sides for name in side.columns.shared.get("severity", ())]
        known = self.policy.labels.severity or tuple(dict.fromkeys(told))
        named = [name for side in sides for name in side.manifest.labels]
        strange = sorted(set(named) - set(known) - {"stable"})
        order = dict.fromkeys((*strange, *known))
        order.pop("stable", None)
        return (*order, "stable")

    def labels(self, side: OpenedStore) -> NDArray[np.int64]:
        """Return each pair's worst label on one side, as its place in `ranks`."""
        codes, words = side.columns.strings("label")
        places = np.array([self.ranks.index(word) for word in words], dtype=np.int64)
        return places[codes[self._rows(side)]]

    def label_sets(self, side: OpenedStore) -> NDArray[np.int64]:
        """Return each pair's labels on one side: bit i says that label i of `ranks` applies."""
        masks, words = side.columns.string_sets("labels")
        rows = self._rows(side)
        translated = np.int64(1) << self.labels(side)
        for bit, word in enumerate(words):
            has = masks[rows] >> bit & 1
            translated |= has << self.ranks.index(word)
        return translated

    @cached_property
    def unasked(self) -> NDArray[np.bool_]:
        """Pairs (n,) of which one run only was looked at in a second pass, as both sweeps say."""
        sweeps = (side.manifest.sweep.resolved for side in (self.baseline, self.candidate))
        if any(sweep.get("checks") != "flagged" for sweep in sweeps):
            return np.zeros(len(self.pairing.baseline), dtype=np.bool_)
        stable = len(self.ranks) - 1
        return (self.labels(self.baseline) == stable) != (self.labels(self.candidate) == stable)

    def run_pairs(
        self, places: Sequence[int], baseline: Sequence[Value], candidate: Sequence[Value]
    ) -> list[RunPair]:
        """Return the pairs at some places with what was found of them."""
        rows = np.asarray(places, dtype=np.intp)
        old = self.baseline.columns.identify(self.pairing.baseline[rows].tolist())
        new = self.candidate.columns.identify(self.pairing.candidate[rows].tolist())
        return [
            RunPair(
                baseline_run=str(one["run_id"]),
                candidate_run=str(other["run_id"]),
                axes=_axes(one),
                baseline=before,
                candidate=after,
            )
            for one, other, before, after in zip(old, new, baseline, candidate, strict=True)
        ]

    def _rows(self, side: OpenedStore) -> NDArray[np.intp]:
        return self.pairing.baseline if side is self.baseline else self.pairing.candidate


def unpaired_runs(side: OpenedStore, rows: Sequence[int]) -> list[RunPair]:
    """Return runs that have no partner."""
    found = side.columns.identify(rows)
    is_old = side.role == "baseline"
    return [
        RunPair(
            baseline_run=str(each["run_id"]) if is_old else None,
            candidate_run=None if is_old else str(each["run_id"]),
            axes=_axes(each),
            baseline=None,
            candidate=None,
        )
        for each in found
    ]


def _axes(found: dict[str, Setting]) -> dict[str, Setting]:
    """Return axis values, and the seed where it is not the first."""
    own = {name: value for name, value in found.items() if name != "run_id"}
    return {name: value for name, value in own.items() if (name, value) != ("seed", 0)}


def _taken(column: NumberColumn, rows: NDArray[np.intp]) -> NumberColumn:
    if len(rows) == len(column.values) and (rows == np.arange(len(rows))).all():
        return column
    return column.at(rows)
