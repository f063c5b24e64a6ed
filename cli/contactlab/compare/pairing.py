"""Which run of the candidate is compared with which run of the baseline."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactlab.compare.opened_stores import OpenedStore
from contactlab.errors import PolicyError, StoreError, did_you_mean

Rows = NDArray[np.intp]
Keys = NDArray[np.int64] | NDArray[np.bytes_]
_DIGITS = 9
"""Axis values are matched to this many digits, since computed ones differ in the last."""


class Pairing(NamedTuple):
    """Rows of two tables that belong together.

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


def pair_by_id(baseline: OpenedStore, candidate: OpenedStore) -> Pairing:
    """Pair runs of one id: of equal scene content, settings, seed and duration."""
    return pair(baseline.columns.byte_strings("run_id"), candidate.columns.byte_strings("run_id"))


def pair_by_axes(baseline: OpenedStore, candidate: OpenedStore) -> Pairing:
    """Pair runs of equal axis values, to 9 digits, and equal seed.

    An axis that one store alone has, with one value, tells none of its runs apart.

    Raises:
        StoreError: the stores sweep other axes, or two runs of one store cannot be told apart.
    """
    names = set(baseline.columns.axis_names)
    other = set(candidate.columns.axis_names)
    differing = {name for name in names - other if _varies(baseline, name)}
    differing |= {name for name in other - names if _varies(candidate, name)}
    if differing:
        raise StoreError(
            f"runs cannot be matched by axes: only one of the stores sweeps "
            f"{', '.join(sorted(differing))}"
        )
    runs = baseline.columns.runs
    keys = np.zeros(runs + candidate.columns.runs, dtype=np.int64)
    for name in (*sorted(names & other), "seed"):
        codes = _codes(baseline, candidate, name)
        keys = np.unique(keys * (codes.max() + 1) + codes, return_inverse=True)[1]
    for side, own in ((baseline, keys[:runs]), (candidate, keys[runs:])):
        _refuse_repeated(side, own)
    return pair(keys[:runs], keys[runs:])


def pair(baseline: Keys, candidate: Keys) -> Pairing:
    """Pair equal keys, of which no side has one twice."""
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
    """Return values to 9 digits."""
    with np.errstate(all="ignore"):
        exponent = np.floor(np.log10(np.abs(values)))
        scale = 10.0 ** (_DIGITS - 1 - np.where(np.isfinite(exponent), exponent, 0))
        return np.where(np.isfinite(scale), np.rint(values * scale) / scale, values)


def _varies(side: OpenedStore, name: str) -> bool:
    codes = _codes(side, side, name)
    return bool((codes != codes[0]).any())


def _codes(baseline: OpenedStore, candidate: OpenedStore, name: str) -> NDArray[np.int64]:
    """Return a number for each run of both stores, equal where the axis has equal values."""
    sides = (baseline, candidate)
    kinds = {side.columns.is_number(name) for side in sides}
    if len(kinds) > 1:
        raise StoreError(f"runs cannot be matched: axis '{name}' has words in one store only")
    if kinds == {True}:
        values = np.concatenate([rounded(side.columns.numbers(name).values) for side in sides])
        return np.unique(values, return_inverse=True)[1]
    known: dict[str, int] = {}
    parts: list[NDArray[np.int64]] = []
    for side in sides:
        codes, words = side.columns.strings(name)
        places = [known.setdefault(word, len(known) + 1) for word in words]
        # The last place is that of runs without a value, whose code is -1.
        parts.append(np.array([*places, 0], dtype=np.int64)[codes])
    return np.concatenate(parts)


def _refuse_repeated(side: OpenedStore, keys: NDArray[np.int64]) -> None:
    values, counts = np.unique(keys, return_counts=True)
    if (counts == 1).all():
        return
    first, second = np.flatnonzero(keys == values[counts > 1][0])[:2].tolist()
    ids = [str(each["run_id"]) for each in side.columns.identify([first, second])]
    raise StoreError(
        f"runs cannot be matched by axes: {' and '.join(ids)} of the {side.role} have equal axis "
        "values and seed"
    )


def groups(
    baseline: OpenedStore, pairing: Pairing, axes: Sequence[str]
) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    """Yield every group's name, such as `cone=elliptic`, and which of the pairs (n,) are in it.

    Without axes, there is one group, whose name is empty. Groups of the whole baseline are
    yielded, whether or not its runs have partners, so that there are the same ones every time.

    Raises:
        PolicyError: an axis was not swept.
    """
    if not axes:
        yield "", np.ones(len(pairing.baseline), dtype=np.bool_)
        return
    columns = [_column(baseline, name) for name in axes]
    stacked = np.stack([codes for codes, _ in columns], axis=1)
    combinations, member = np.unique(stacked, axis=0, return_inverse=True)
    of_pairs = member.reshape(-1)[pairing.baseline]
    for number, combination in enumerate(combinations.tolist()):
        values = [words[code] for code, (_, words) in zip(combination, columns, strict=True)]
        name = ", ".join(f"{axis}={value}" for axis, value in zip(axes, values, strict=True))
        yield name, of_pairs == number


def _column(baseline: OpenedStore, axis: str) -> tuple[NDArray[np.int64], list[str]]:
    """Return each run's code of an axis, and what the codes stand for."""
    swept = baseline.columns.axis_names
    if axis not in swept:
        hint = did_you_mean(axis, swept) or f"; swept are {', '.join(swept) or 'none'}"
        raise PolicyError(f"the policy groups by '{axis}', which is no axis of the baseline{hint}")
    if baseline.columns.is_number(axis):
        values = rounded(baseline.columns.numbers(axis).values)
        distinct, codes = np.unique(values, return_inverse=True)
        return codes, [f"{value:.9g}" for value in distinct.tolist()]
    codes, words = baseline.columns.strings(axis)
    return codes, [*words, "none"]
