"""What a page shows in place of runs that are too many: every cell of every map, summed up."""

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import Floats
from contactlab.report.cells import STATISTICS, Plane, label_counts
from contactlab.report.grid import SEED, GridAxis
from contactlab.report.outcomes import Outcomes
from contactlab.report.packing import real, whole
from contactlab.report.quantities import Quantity

MOST_AXES = 8


def summed_axes(axes: Sequence[GridAxis]) -> tuple[GridAxis, ...]:
    """Return the axes over which sums are made: of very many the first ones, the seed last."""
    return tuple(sorted(axes, key=lambda axis: axis.name == SEED)[:MOST_AXES])


def sums(
    axes: Sequence[GridAxis], outcomes: Outcomes, quantities: Sequence[Quantity]
) -> dict[str, NDArray[Any]]:
    """Return the columns that hold the maps over every two axes, and over each alone.

    They are called `sum:X:Y:labels` and `sum:X:Y:QUANTITY:STATISTIC`, X and Y being the places of
    the axes, and Y empty for one axis.
    """
    planes = dict(_planes(axes))
    found: dict[str, NDArray[Any]] = {
        f"{name}:labels": whole(label_counts(plane, outcomes).ravel())
        for name, plane in planes.items()
    }
    cells = {name: plane.cells.astype(np.uint16) for name, plane in planes.items()}
    for quantity in quantities:
        order = np.argsort(quantity.values)[: int(np.isfinite(quantity.values).sum())]
        for name, plane in planes.items():
            size = plane.shape[0] * plane.shape[1]
            three = statistics(cells[name], size, quantity, order)
            for kind, values in zip(STATISTICS, three, strict=True):
                found[f"{name}:{quantity.name}:{kind}"] = real(values)
    return found


def _planes(axes: Sequence[GridAxis]) -> Iterator[tuple[str, Plane]]:
    for place, axis in enumerate(axes):
        yield f"sum:{place}:", Plane(axis, None)
    for (first, x), (second, y) in combinations(enumerate(axes), 2):
        yield f"sum:{first}:{second}", Plane(x, y)


def statistics(
    cells: NDArray[np.uint16], size: int, quantity: Quantity, order: NDArray[np.intp]
) -> tuple[Floats, Floats, Floats]:
    """Return worst, median and mean of a quantity in each cell, NaN where it has no value.

    One sorting of the values serves every plane: a stable sorting of small numbers by cell, which
    is linear in time, then leaves each cell's values in order.

    Args:
        cells: (n,) cell of each run.
        size: how many cells there are.
        quantity: n values.
        order: (m,) the runs that have a value, the least first.
    """
    own, values = cells[order], quantity.values[order]
    inner = np.argsort(own, kind="stable")
    counts = np.bincount(own, minlength=size)
    some = counts > 0
    ends = counts.cumsum()[some]
    number = counts[some]
    starts = ends - number

    def at(places: NDArray[np.intp]) -> Floats:
        return values[inner[places]]

    low, high = at(starts), at(ends - 1)
    worst = low if quantity.told.better == "higher" else np.maximum(np.abs(low), np.abs(high))
    median = (at(starts + (number - 1) // 2) + at(starts + number // 2)) / 2
    mean = np.bincount(own, values, minlength=size)[some] / number
    found = np.full((3, size), np.nan)
    found[:, some] = worst, median, mean
    return found[0], found[1], found[2]
