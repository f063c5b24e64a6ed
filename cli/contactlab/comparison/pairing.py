"""Pairs of runs, by id or by axis values, and groups of pairs by the values of some axes."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactlab.errors import PolicyError, StoreError, did_you_mean
from contactlab.store.finished_store import Store

Rows = NDArray[np.intp]
Keys = NDArray[np.int64] | NDArray[np.bytes_]
_DIGITS = 9
"""Digits to which axis values must agree: computed values differ in the last ones."""


class Pairing(NamedTuple):
    """Pairs of runs, as rows of the two tables.

    Attributes:
        baseline: (n,) rows of the baseline that have a partner.
        candidate: (n,) the partners.
        missing: rows that only the baseline has.
        new: rows that only the candidate has.
    """

    baseline: Rows
    candidate: Rows
    missing: Rows
    new: Rows

    def where(self, mask: NDArray[np.bool_]) -> "Pairing":
        """Return some of the pairs."""
        return self._replace(baseline=self.baseline[mask], candidate=self.candidate[mask])


def pair_by_id(baseline: Store, candidate: Store) -> Pairing:
    """Pair runs of equal id: of the same scene content, settings, seed and duration."""
    return pair(baseline.columns.byte_strings("run_id"), candidate.columns.byte_strings("run_id"))


def pair_by_axes(baseline: Store, candidate: Store) -> Pairing:
    """Pair runs of equal axis values, to 9 digits, and equal seed.

    An axis with a single value may be missing in the other store.

    Raises:
        StoreError: the stores sweep different axes, or two runs of one store are equal in all.
    """
    names = set(baseline.columns.axis_names)
    other = set(candidate.columns.axis_names)
    differing = {name for name in names - other if _varies(baseline, name)}
    differing |= {name for name in other - names if _varies(candidate, name)}
    if differing:
        raise StoreError(
            "runs cannot be matched by axes: only one of the stores sweeps "
            f"{', '.join(sorted(differing))}"
        )
    runs = baseline.columns.runs
    keys = np.zeros(runs + candidate.columns.runs, dtype=np.int64)
    for name in (*sorted(names & other), "seed"):
        codes = _codes(baseline, candidate, name)
        keys = np.unique(keys * (codes.max() + 1) + codes, return_inverse=True)[1]
    _refuse_repeated(baseline, "baseline", keys[:runs])
    _refuse_repeated(candidate, "candidate", keys[runs:])
    return pair(keys[:runs], keys[runs:])


def pair(baseline: Keys, candidate: Keys) -> Pairing:
    """Pair equal keys; the keys of each store are distinct."""
    if baseline.shape == candidate.shape and np.array_equal(baseline, candidate):
        rows = np.arange(len(baseline))
        return Pairing(rows, rows, rows[:0], rows[:0])
    order = np.argsort(candidate)
    place = np.searchsorted(candidate, baseline, sorter=order)
    partner = order[np.minimum(place, len(order) - 1)]
    found = candidate[partner] == baseline
    new = np.ones(len(candidate), dtype=np.bool_)
    new[partner[found]] = False
    return Pairing(
        np.flatnonzero(found), partner[found], np.flatnonzero(~found), np.flatnonzero(new)
    )


def rounded(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return values rounded to 9 digits."""
    with np.errstate(all="ignore"):
        exponent = np.floor(np.log10(np.abs(values)))
        scale = 10.0 ** (_DIGITS - 1 - np.where(np.isfinite(exponent), exponent, 0))
        return np.where(np.isfinite(scale), np.rint(values * scale) / scale, values)


def _varies(store: Store, name: str) -> bool:
    codes = _codes(store, store, name)
    return bool((codes != codes[0]).any())


def _codes(baseline: Store, candidate: Store, name: str) -> NDArray[np.int64]:
    """Return a number for each run of both stores; equal numbers are equal values of the axis."""
    stores = (baseline, candidate)
    kinds = {each.columns.is_number(name) for each in stores}
    if len(kinds) > 1:
        raise StoreError(f"runs cannot be matched: axis '{name}' is text in one store only")
    if kinds == {True}:
        values = np.concatenate([rounded(each.columns.numbers(name).values) for each in stores])
        return np.unique(values, return_inverse=True)[1]
    known: dict[str, int] = {}
    parts: list[NDArray[np.int64]] = []
    for each in stores:
        codes, words = each.columns.strings(name)
        numbers = [known.setdefault(word, len(known) + 1) for word in words]
        # Runs without a value have code -1, and so the last number.
        parts.append(np.array([*numbers, 0], dtype=np.int64)[codes])
    return np.concatenate(parts)


def _refuse_repeated(store: Store, role: str, keys: NDArray[np.int64]) -> None:
    values, counts = np.unique(keys, return_counts=True)
    if (counts == 1).all():
        return
    first, second = np.flatnonzero(keys == values[counts > 1][0])[:2].tolist()
    ids = [str(each["run_id"]) for each in store.columns.identify([first, second])]
    raise StoreError(
        f"runs cannot be matched by axes: {' and '.join(ids)} of the {role} have equal axis "
        "values and seed"
    )


def groups(
    baseline: Store, pairing: Pairing, axes: Sequence[str]
) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    """Yield the name of each group, such as `cone=elliptic`, and a mask (n,) of its pairs.

    Without axes there is one group, whose name is empty. Groups are those of the whole baseline,
    so that they do not depend on the candidate.

    Raises:
        PolicyError: an axis was not swept.
    """
    if not axes:
        yield "", np.ones(len(pairing.baseline), dtype=np.bool_)
        return
    columns = [_column(baseline, name) for name in axes]
    stacked = np.stack([codes for codes, _ in columns], axis=1)
    combinations, member = np.unique(stacked, axis=0, return_inverse=True)
    group = member.reshape(-1)[pairing.baseline]
    for number, combination in enumerate(combinations.tolist()):
        values = [words[code] for code, (_, words) in zip(combination, columns, strict=True)]
        name = ", ".join(f"{axis}={value}" for axis, value in zip(axes, values, strict=True))
        yield name, group == number


def _column(baseline: Store, axis: str) -> tuple[NDArray[np.int64], list[str]]:
    """Return the code of each run's value of an axis, and the values as text."""
    swept = baseline.columns.axis_names
    if axis not in swept:
        hint = did_you_mean(axis, swept) or f"; its axes are {', '.join(swept) or 'none'}"
        raise PolicyError(
            f"the policy groups by '{axis}', which is not an axis of the baseline{hint}"
        )
    if baseline.columns.is_number(axis):
        values = rounded(baseline.columns.numbers(axis).values)
        distinct, codes = np.unique(values, return_inverse=True)
        return codes, [f"{value:.9g}" for value in distinct.tolist()]
    codes, words = baseline.columns.strings(axis)
    return codes, [*words, "none"]
