"""Pairs of runs by id or by axis values, groups of pairs, and how the two stores differ."""

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from datetime import date
from functools import cached_property
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from contactlab.errors import PolicyError, StoreError
from contactlab.judge.subjects import Mask
from contactlab.schema.comparison import ComparePolicy, Sameness
from contactlab.schema.evidence import Setting
from contactlab.schema.finding import RunPair
from contactlab.store.finished_store import Store
from contactlab.store.run_columns import NumberColumn, equal_texts, places_among

Rows = NDArray[np.intp]
Value = float | str | None
Keys = NDArray[np.int64] | NDArray[np.uint64]
Ranks = NDArray[np.int16]
_SEVERAL = "several values"
_Side = TypeVar("_Side")
_Result = TypeVar("_Result")


class Pairing(NamedTuple):
    """Pairs of runs, as rows of the two tables."""

    baseline: Rows  # (n,) rows of the baseline that have a partner
    candidate: Rows  # (n,) the partners
    missing: Rows  # rows that only the baseline has
    new: Rows  # rows that only the candidate has
    is_in_order: bool = False  # whether the partner of each row is the same row of the candidate


def for_both(function: Callable[[_Side], _Result], sides: Sequence[_Side]) -> list[_Result]:
    """Return the results of a function for two stores, each in its own thread.

    Reading columns and computing with them releases the lock of the interpreter.
    """
    with ThreadPoolExecutor(1) as pool:
        ahead = [pool.submit(function, side) for side in sides[1:]]
        return [function(sides[0]), *(each.result() for each in ahead)]


def pair_by_axes(baseline: Store, candidate: Store) -> Pairing:
    """Pair runs of equal axis values, to 9 digits, and equal seed.

    An axis with a single value in each store is the subject of the comparison, as is one that only
    one store has, with a single value. A StoreError says that the stores sweep different axes, or
    that two runs of one store are equal in all.
    """
    names, other = (set(store.columns.axis_names) for store in (baseline, candidate))
    if differing := {
        name
        for store, own in ((baseline, names - other), (candidate, other - names))
        for name in own
        if np.ptp(_axis_codes((store,), name)[0])
    }:
        raise StoreError(
            "runs cannot be matched by axes: only one of the stores sweeps "
            f"{', '.join(sorted(differing))}"
        )
    runs = baseline.columns.runs
    keys = np.zeros(runs + candidate.columns.runs, dtype=np.int64)
    for name in (*sorted(names & other - {*settings_apart(baseline, candidate)}), "seed"):
        codes, _ = _axis_codes((baseline, candidate), name)
        keys = np.unique(keys * (codes.max() + 1) + codes, return_inverse=True)[1]
    _refuse_repeated(baseline, "baseline", keys[:runs])
    _refuse_repeated(candidate, "candidate", keys[runs:])
    return pair_keys(keys[:runs], keys[runs:])


def settings_apart(baseline: Store, candidate: Store) -> set[str]:
    """Return the axes that have one value in each store, and not the same."""
    own, other = map(_axis_settings, (baseline, candidate))
    return {
        axis
        for axis in own.keys() & other.keys()
        if _SEVERAL not in {own[axis], other[axis]} and own[axis] != other[axis]
    }


def explain_unpaired(baseline: Store, candidate: Store) -> str:
    """Say why no run of one store has the axis values and the seed of one of the other."""
    names = {*baseline.columns.axis_names} & {*candidate.columns.axis_names}
    unshared = list[str]()
    for name in (*sorted(names - settings_apart(baseline, candidate)), "seed"):
        codes, _ = _axis_codes((baseline, candidate), name)
        own, other = np.split(codes, [baseline.columns.runs])
        if not np.isin(own, other).any():
            unshared.append(name)
    if unshared:
        return f"they have no {' and no '.join(unshared)} in common; sweep the same values in both"
    return "no axis values and seed are equal; sweep the same values in both"


def pair_keys(baseline: Keys, candidate: Keys) -> Pairing:
    """Pair equal keys; the keys of each store are distinct."""
    if baseline.shape == candidate.shape and np.array_equal(baseline, candidate):
        rows = np.arange(len(baseline))
        return Pairing(rows, rows, rows[:0], rows[:0], is_in_order=True)
    places = places_among(baseline, candidate)
    has_partner, is_new = places >= 0, np.ones(len(candidate), np.bool_)
    is_new[places[has_partner]] = False
    rows = np.flatnonzero(has_partner)
    return Pairing(rows, places[rows], np.flatnonzero(~has_partner), np.flatnonzero(is_new))


def round_values(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return values rounded to 9 digits."""
    with np.errstate(all="ignore"):
        exponent = np.floor(np.log10(np.abs(values)))
        digits = 9  # of equal axis values: the last digits of computed ones differ
        scale = 10.0 ** (digits - 1 - np.where(np.isfinite(exponent), exponent, 0))
        return np.where(np.isfinite(scale), np.rint(values * scale) / scale, values)


def _axis_codes(
    stores: Sequence[Store], axis: str
) -> tuple[NDArray[np.int64], Sequence[float | str]]:
    """Return a code for each run of some stores, store by store, and the value of each code."""
    kinds = {store.columns.is_number(axis) for store in stores}
    if len(kinds) > 1:
        raise StoreError(f"runs cannot be matched: axis '{axis}' is text in one store only")
    if kinds == {True}:
        values = np.concatenate(
            [round_values(store.columns.numbers(axis).values) for store in stores]
        )
        distinct, codes = np.unique(values, return_inverse=True)
        return codes, distinct.tolist()
    numbers_of_words: dict[str | None, int] = {None: 0}
    parts: list[NDArray[np.int64]] = []
    for store in stores:
        codes, words = store.columns.read_codes(axis)
        numbers = [numbers_of_words.setdefault(word, len(numbers_of_words)) for word in words]
        parts.append(np.array(numbers, dtype=np.int64)[codes])
    return np.concatenate(parts), ["none" if word is None else word for word in numbers_of_words]


def _refuse_repeated(store: Store, role: str, keys: NDArray[np.int64]) -> None:
    values, counts = np.unique(keys, return_counts=True)
    if (counts == 1).all():
        return
    first, second = np.flatnonzero(keys == values[counts > 1][0])[:2].tolist()
    ids = [str(identity["run_id"]) for identity in store.columns.identify([first, second])]
    raise StoreError(
        f"runs cannot be matched by axes: {' and '.join(ids)} of the {role} have equal axis "
        "values and seed"
    )


def settings_of(store: Store) -> Rows:
    """Return (runs) a code for each run of a store: equal where all axis values are."""
    names = store.columns.axis_names
    settings = np.zeros(store.columns.runs, np.int64)
    for name in names:
        codes, values = _axis_codes((store,), name)
        settings = np.unique(settings * len(values) + codes, return_inverse=True)[1]
    return settings


def group_pairs(
    baseline: Store, pairing: Pairing, axes: Sequence[str]
) -> Iterator[tuple[str, Mask]]:
    """Yield the name of each group, such as `cone=elliptic`, and a mask (n,) of its pairs.

    Without axes there is one group with an empty name. Groups are those of the whole baseline,
    so that they do not depend on the candidate. An axis that was not swept is a PolicyError.
    """
    if not axes:
        yield "", np.ones(len(pairing.baseline), dtype=np.bool_)
        return
    swept = baseline.columns.axis_names
    for axis in axes:
        message = f"the policy groups by '{axis}', which is not an axis of the baseline"
        PolicyError.unless_known(
            axis, swept, message, f"; its axes are {', '.join(swept) or 'none'}"
        )
    columns = [_axis_codes((baseline,), axis) for axis in axes]
    stacked = np.stack([codes for codes, _ in columns], axis=1)
    combinations, member = np.unique(stacked, axis=0, return_inverse=True)
    group = member.reshape(-1)[pairing.baseline]
    for number, combination in enumerate(combinations.tolist()):
        values = [
            axis_values[code] for code, (_, axis_values) in zip(combination, columns, strict=True)
        ]
        texts = [f"{value:.9g}" if isinstance(value, float) else value for value in values]
        name = ", ".join(f"{axis}={text}" for axis, text in zip(axes, texts, strict=True))
        yield name, group == number


@dataclass(frozen=True)
class PairedStores:
    """Two stores and the n pairs of their runs; exceptions of the policy expire by `today`."""

    baseline: Store
    candidate: Store
    pairing: Pairing
    policy: ComparePolicy
    today: date

    def without_pairs(self, excluded: Mask) -> "PairedStores":
        """Return the same without some of the pairs (n,)."""
        if not excluded.any():
            return self
        kept_pairs, rows = ~excluded, self.pairing
        before, after = rows.baseline[kept_pairs], rows.candidate[kept_pairs]
        rows = rows._replace(baseline=before, candidate=after, is_in_order=False)
        return replace(self, pairing=rows)

    @property
    def sides(self) -> tuple[tuple[Store, Rows], ...]:
        """Both stores, each with the rows (n,) of its runs in the order of the pairs."""
        return (self.baseline, self.pairing.baseline), (self.candidate, self.pairing.candidate)

    def read_numbers(self, name: str) -> tuple[NumberColumn, NumberColumn]:
        """Return a column of both stores, (n,) each; empty where a store has no such column."""
        before, after = (self._side_numbers(*side, name) for side in self.sides)
        return before, after

    def map_in_threads(
        self, function: Callable[[_Side], _Result], values: Iterable[_Side]
    ) -> Iterator[_Result]:
        """Yield the results of a function for each metric, in their order, by two threads.

        Each thread has the columns of one metric in memory.
        """
        # Masks that all metrics need are computed before, and once.
        _ = self.bitwise_equal, self.half_checked
        if self.policy.judge == "spread":
            _ = self.trajectories
        with ThreadPoolExecutor(2) as pool:
            yield from pool.map(function, values)

    def _side_numbers(self, store: Store, rows: Rows, name: str) -> NumberColumn:
        if name not in store.columns.schema.names:
            return NumberColumn(np.full(len(rows), np.nan), np.zeros(len(rows), dtype=np.bool_))
        return store.columns.numbers(name).at(self._side_rows(store))

    @cached_property
    def ranks(self) -> "tuple[str, ...]":
        """All labels, worst first: in the order of the policy, or of this contactlab.

        No store changes the order of labels that are known here. Other labels, of plug-ins, stand
        where the baseline has them, or the candidate. Labels that no order names count as the
        worst.
        """
        # Loaded only here, since most readers of stores need no labels.
        from contactlab.measure import LABELS  # noqa: PLC0415

        stores = (self.baseline, self.candidate)
        known_labels = [*(self.policy.labels.severity or LABELS)]
        for store in stores if self.policy.labels.severity is None else ():
            stored = [str(name) for name in store.columns.shared.get("severity", ())]
            for place, name in enumerate(stored):
                if name not in known_labels:
                    worse_than = next(
                        (next_ for next_ in stored[place:] if next_ in known_labels), None
                    )
                    known_labels.insert(
                        known_labels.index(worse_than) if worse_than else len(known_labels), name
                    )
        used_labels = {name for store in stores for name in store.manifest.labels}
        order = dict.fromkeys(
            (*sorted(used_labels - set(known_labels) - {"stable"}), *known_labels)
        )
        order.pop("stable", None)
        return (*order, "stable")

    def read_labels(self, store: Store) -> Ranks:
        """Return (n,) the worst label of each pair's run in one store, as its index in `ranks`."""
        return self._labels[0 if store is self.baseline else 1]

    @cached_property
    def _labels(self) -> tuple[Ranks, Ranks]:
        before, after = for_both(self._coded_labels, (self.baseline, self.candidate))
        return before, after

    def _coded_labels(self, store: Store) -> Ranks:
        codes, words = store.columns.read_codes("label")
        indices = np.array([self.ranks.index(word) for word in words], dtype=np.int16)
        return indices[codes[self._side_rows(store)]]

    @cached_property
    def bitwise_equal(self) -> Mask:
        """Pairs (n,) with bitwise equal trajectories."""
        name = "trajectory_hash"
        if self.pairing.is_in_order:
            return equal_texts(self.baseline.columns, self.candidate.columns, name)
        # One after the other: the texts of many runs fill memory.
        before, after = (store.columns.byte_strings(name)[rows] for store, rows in self.sides)
        return (before == after) & (before != b"")

    @cached_property
    def trajectories(self) -> Keys:
        """(n,) a number for each pair, equal where both trajectories are, bit for bit.

        Runs of settings without effect, or of seeds without noise, tell the same twice.
        """
        both = np.zeros(len(self.pairing.baseline), np.int64)
        for store, rows in self.sides:
            hashes = store.columns.byte_strings("trajectory_hash")[rows]
            values, codes = np.unique(hashes, return_inverse=True)
            is_unknown = values[codes] == b""
            codes = np.where(is_unknown, len(values) + np.arange(len(codes)), codes)
            both = np.unique(both * (2 * len(codes) + 1) + codes, return_inverse=True)[1]
        return both

    def select_once(self, member: Mask, *values: NDArray[np.generic]) -> Mask:
        """Return the pairs of a group (n,), those with equal trajectories and values once."""
        # Most trajectories are the only ones of their kind, and sorting all by value takes seconds.
        repeated = np.bincount(self.trajectories)[self.trajectories] > 1
        rows = np.flatnonzero(member & repeated)
        if not len(rows):
            return member
        columns = (self.trajectories[rows], *(one[rows] for one in values))
        keys = np.stack([np.unique(one, return_inverse=True)[1] for one in columns])
        once = member & ~repeated
        once[rows[np.unique(keys, axis=1, return_index=True)[1]]] = True
        return once

    @cached_property
    def knife_edges(self) -> tuple[Mask, Mask]:
        """(n,) which runs of each store are on a knife edge, by a sweep that looked for them."""
        before, after = (
            self._side_numbers(store, rows, "knife_edge").values == 1
            if store.manifest.sweep.resolved.get("knife_edge")
            else np.zeros(len(rows), np.bool_)
            for store, rows in self.sides
        )
        return before, after

    @cached_property
    def knife_edge(self) -> Mask:
        """Pairs (n,) with a run that gets another label if it starts 1e-6 away."""
        before, after = self.knife_edges
        return before | after

    def label_sets(self, store: Store) -> NDArray[np.int64]:
        """Return (n,) all labels of each pair's run in one store: bit i is label i of `ranks`."""
        masks, words = store.columns.string_sets("labels")
        masks, sets = masks[self._side_rows(store)], np.int64(1) << self.read_labels(store)
        places = [self.ranks.index(word) for word in words]
        at_once = 1 << 20  # number of pairs that are joined at once
        # All at once, the intermediate arrays would take five times the memory.
        for first in range(0, len(sets), at_once):
            own, part = masks[first : first + at_once], sets[first : first + at_once]
            for bit, place in enumerate(places):
                part |= (own >> bit & 1) << place
        return sets

    @cached_property
    def half_checked(self) -> Mask:
        """Pairs (n,) with one run that both sweeps checked only in their second pass."""
        sweeps = (store.manifest.sweep.resolved for store in (self.baseline, self.candidate))
        if any(sweep.get("checks") != "flagged" for sweep in sweeps):
            return np.zeros(len(self.pairing.baseline), dtype=np.bool_)
        stable = len(self.ranks) - 1
        return (self.read_labels(self.baseline) == stable) != (
            self.read_labels(self.candidate) == stable
        )

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
                axes=_run_axes(one),
                baseline=before,
                candidate=after,
            )
            for one, other, before, after in zip(old, new, baseline, candidate, strict=True)
        ]

    def _side_rows(self, store: Store) -> Rows | slice:
        return self._selected_rows[0 if store is self.baseline else 1]

    @cached_property
    def _selected_rows(self) -> tuple[Rows | slice, Rows | slice]:
        # A slice of all rows copies nothing.
        before, after = (
            slice(None) if np.array_equal(rows, np.arange(store.columns.runs)) else rows
            for store, rows in self.sides
        )
        return before, after


def unpaired_runs(store: Store, role: str, rows: Sequence[int]) -> list[RunPair]:
    """Return some runs of the baseline or candidate that have no partner in the other store."""
    none = RunPair(baseline_run=None, candidate_run=None, axes={}, baseline=None, candidate=None)
    return [
        none.model_copy(
            update={f"{role}_run": str(identity["run_id"]), "axes": _run_axes(identity)}
        )
        for identity in store.columns.identify(rows)
    ]


def _run_axes(identity: dict[str, Setting]) -> dict[str, Setting]:
    return {
        name: value
        for name, value in identity.items()
        if name != "run_id" and (name, value) != ("seed", 0)
    }


def engine_of(store: Store) -> str:
    """Return name and version of the engine that computed a store."""
    engine = store.manifest.sweep.engine
    return f"{engine.name} {engine.version}"


def _axis_settings(store: Store) -> dict[str, str]:
    return {axis: _axis_setting(store, axis) for axis in store.columns.axis_names}


def _demands_of(store: Store) -> dict[str, str]:
    # Requirements, expectations and tolerances, as short text.
    resolved = store.manifest.sweep.resolved
    texts = {name: resolved.get(name) for name in ("must", "expect", "tolerances")}
    return {name: _short_json(value) for name, value in texts.items() if value}


def _short_json(value: object) -> str:
    text, most = json.dumps(value, sort_keys=True), 160
    # The end tells apart texts that begin alike.
    end = hashlib.sha256(text.encode()).hexdigest()[:8]
    return text if len(text) <= most else f"{text[:most]}... ({end})"


def _axis_setting(store: Store, axis: str) -> str:
    if store.columns.is_number(axis):
        values = store.columns.numbers(axis).values
        low, high = round_values(np.array([values.min(), values.max()]))
        return f"{low:.9g}" if low == high else _SEVERAL
    codes, words = store.columns.read_codes(axis)
    used_codes = np.flatnonzero(np.bincount(codes))
    return _SEVERAL if len(used_codes) > 1 else words[used_codes[0]] or "none"


_PROPERTIES: Mapping[Sameness, Callable[[Store], str | Mapping[str, object]]] = {
    "sweep": lambda store: store.manifest.sweep.name,
    "scene": lambda store: store.manifest.sweep.scene,
    "scene_hash": lambda store: store.manifest.sweep.scene_hash,
    "settings": _axis_settings,
    "metric_versions": lambda store: store.manifest.sweep.metric_versions,
    "thresholds": lambda store: store.manifest.sweep.resolved.get("thresholds", {}),
    "demands": _demands_of,
    "engine": engine_of,
    "contactlab": lambda store: store.manifest.provenance.contactlab,
    "python": lambda store: store.manifest.provenance.python,
    "numpy": lambda store: store.manifest.provenance.numpy,
    "cpu_model": lambda store: store.manifest.provenance.host.cpu_model,
    "cpu_flags": lambda store: store.manifest.provenance.host.cpu_flags,
    "os": lambda store: store.manifest.provenance.host.os,
}


def find_difference(baseline: Store, candidate: Store, what: Sameness) -> tuple[str, str] | None:
    """Return the two values of a property of two stores; None if they are the same."""
    before, after = (_PROPERTIES[what](store) for store in (baseline, candidate))
    if isinstance(before, str) or isinstance(after, str):
        return (str(before), str(after)) if before != after else None
    shared = what == "metric_versions"
    names = before.keys() & after.keys() if shared else before.keys() | after.keys()
    differing = sorted(name for name in names if before.get(name) != after.get(name))
    if not differing:
        return None
    return _format_table(before, differing), _format_table(after, differing)


def _format_table(table: Mapping[str, object], names: list[str]) -> str:
    return ", ".join(f"{name} {table.get(name, 'by default')}" for name in names)
