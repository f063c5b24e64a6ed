"""Pairs by the values of some axes, each of whose combinations is judged by itself."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from contactlab.compare.pairing import Pairing, rounded
from contactlab.compare.sides import Side
from contactlab.errors import PolicyError, did_you_mean


def groups(
    baseline: Side, pairing: Pairing, axes: Sequence[str]
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


def _column(baseline: Side, axis: str) -> tuple[NDArray[np.int64], list[str]]:
    """Return each run's code of an axis, and what the codes stand for."""
    swept = baseline.columns.axis_names
    if axis not in swept:
        hint = did_you_mean(axis, swept) or f"; swept are {', '.join(swept) or 'none'}"
        raise PolicyError(f"the policy groups by '{axis}', which is no axis of the baseline{hint}")
    if baseline.columns.is_number(axis):
        values = rounded(baseline.columns.numbers(axis).values)
        distinct, codes = np.unique(values, return_inverse=True)
        return codes, [f"{value:.9g}" for value in distinct.tolist()]
    codes, words = baseline.columns.words(axis)
    return codes, [*words, "none"]
