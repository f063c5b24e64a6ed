"""The two stores, pair by pair: columns, labels and descriptions of the paired runs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import date
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from contactlab.comparison.pairing import Pairing
from contactlab.schema.compare_policy import ComparePolicy
from contactlab.schema.comparison_report import RunPair
from contactlab.schema.evidence import Setting
from contactlab.store.finished_store import Store
from contactlab.store.run_columns import NumberColumn

Value = float | str | None


@dataclass(frozen=True)
class PairedStores:
    """Two stores and the pairs of their runs.

    Attributes:
        pairing: the n pairs of runs.
        today: the day by which exceptions of the policy expire.
    """

    baseline: Store
    candidate: Store
    pairing: Pairing
    policy: ComparePolicy
    today: date

    def without(self, excluded: NDArray[np.bool_]) -> "PairedStores":
        """Return the same without some of the pairs (n,)."""
        if not excluded.any():
            return self
        return replace(self, pairing=self.pairing.where(~excluded))

    def numbers(self, name: str) -> tuple[NumberColumn, NumberColumn]:
        """Return a column of both stores, (n,) each; empty where a store has no such column."""
        return self._numbers(self.baseline, name), self._numbers(self.candidate, name)

    def _numbers(self, store: Store, name: str) -> NumberColumn:
        rows = self._rows(store)
        if name not in store.columns.schema.names:
            return NumberColumn(np.full(len(rows), np.nan), np.zeros(len(rows), dtype=np.bool_))
        column = store.columns.numbers(name)
        if len(rows) == len(column.values) and (rows == np.arange(len(rows))).all():
            return column
        return column.at(rows)

    @cached_property
    def ranks(self) -> "tuple[str, ...]":
        """All labels, worst first: in the order of the policy, or else of the stores.

        Labels that this order does not name count as the worst.
        """
        stores = (self.candidate, self.baseline)
        stored = [str(name) for each in stores for name in each.columns.shared.get("severity", ())]
        known = self.policy.labels.severity or tuple(dict.fromkeys(stored))
        used = {name for each in stores for name in each.manifest.labels}
        order = dict.fromkeys((*sorted(used - set(known) - {"stable"}), *known))
        order.pop("stable", None)
        return (*order, "stable")

    def labels(self, store: Store) -> NDArray[np.int64]:
        """Return (n,) the worst label of each pair's run in one store, as its index in `ranks`."""
        codes, words = store.columns.strings("label")
        indices = np.array([self.ranks.index(word) for word in words], dtype=np.int64)
        return indices[codes[self._rows(store)]]

    def label_sets(self, store: Store) -> NDArray[np.int64]:
        """Return (n,) all labels of each pair's run in one store: bit i is label i of `ranks`."""
        masks, words = store.columns.string_sets("labels")
        rows = self._rows(store)
        sets = np.int64(1) << self.labels(store)
        for bit, word in enumerate(words):
            sets |= (masks[rows] >> bit & 1) << self.ranks.index(word)
        return sets

    @cached_property
    def half_checked(self) -> NDArray[np.bool_]:
        """Pairs (n,) of which both sweeps checked one run only in their second pass."""
        sweeps = (each.manifest.sweep.resolved for each in (self.baseline, self.candidate))
        if any(sweep.get("checks") != "flagged" for sweep in sweeps):
            return np.zeros(len(self.pairing.baseline), dtype=np.bool_)
        stable = len(self.ranks) - 1
        return (self.labels(self.baseline) == stable) != (self.labels(self.candidate) == stable)

    def run_pairs(
        self, indices: Sequence[int], baseline: Sequence[Value], candidate: Sequence[Value]
    ) -> list[RunPair]:
        """Return some of the pairs, by index, with a value of each of their runs."""
        rows = np.asarray(indices, dtype=np.intp)
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

    def _rows(self, store: Store) -> NDArray[np.intp]:
        return self.pairing.baseline if store is self.baseline else self.pairing.candidate


def unpaired_runs(store: Store, role: str, rows: Sequence[int]) -> list[RunPair]:
    """Return some runs of the baseline or candidate that have no partner in the other store."""
    none = RunPair(baseline_run=None, candidate_run=None, axes={}, baseline=None, candidate=None)
    return [
        none.model_copy(update={f"{role}_run": str(each["run_id"]), "axes": _axes(each)})
        for each in store.columns.identify(rows)
    ]


def _axes(identity: dict[str, Setting]) -> dict[str, Setting]:
    """Return the axis values of a run, and its seed unless that is 0."""
    return {
        name: value
        for name, value in identity.items()
        if name != "run_id" and (name, value) != ("seed", 0)
    }
