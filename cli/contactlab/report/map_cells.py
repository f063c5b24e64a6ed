"""What lies in each cell of a heatmap: counts of labels, or one number."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import Floats
from contactlab.report.packing import packed_integers, rounded_floats
from contactlab.report.report_columns import SEED, STABLE, Codes, GridAxis, Quantity, RunLabels

Statistic = Literal["worst", "median", "mean"]
STATISTICS: tuple[Statistic, ...] = ("worst", "median", "mean")


@dataclass(frozen=True)
class MapAxes:
    """Two axes that a heatmap is drawn over, for n runs.

    Attributes:
        x: the axis across.
        y: the axis upwards; None for a single row.
    """

    x: GridAxis
    y: GridAxis | None

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return (1 if self.y is None else len(self.y.words), len(self.x.words))

    @property
    def cells(self) -> Codes:
        """(n,) the cell of each run, row by row."""
        rows = 0 if self.y is None else self.y.codes
        return rows * len(self.x.words) + self.x.codes


def label_counts(plane: MapAxes, outcomes: RunLabels) -> NDArray[np.int64]:
    """Return (rows, columns, labels) how many runs have which worst label."""
    labels, size = len(outcomes.names), plane.shape[0] * plane.shape[1]
    places = plane.cells * labels + outcomes.codes
    return np.bincount(places, minlength=size * labels).reshape(*plane.shape, labels)


def cell_statistic(plane: MapAxes, quantity: Quantity, kind: Statistic) -> Floats:
    """Return (rows, columns) one statistic of a quantity, over the runs that have a value of it.

    The worst is the largest size, or the least value of what is better the higher it is.
    """
    known = np.flatnonzero(np.isfinite(quantity.values))
    order = known[np.argsort(plane.cells[known], kind="stable")]
    found, starts = np.unique(plane.cells[order], return_index=True)
    result = np.full(plane.shape, np.nan)
    if len(found):
        result.flat[found] = _reduced(quantity, quantity.values[order], starts, kind)
    return result


def _reduced(quantity: Quantity, values: Floats, starts: Codes, kind: Statistic) -> Floats:
    counts = np.diff([*starts, len(values)])
    if kind == "mean":
        return np.add.reduceat(values, starts) / counts
    if kind == "worst":
        if quantity.told.better == "higher":
            return np.minimum.reduceat(values, starts)
        return np.maximum.reduceat(np.abs(values), starts)
    cells = np.repeat(np.arange(len(starts)), counts)
    ordered = values[np.lexsort((values, cells))]
    return (ordered[starts + (counts - 1) // 2] + ordered[starts + counts // 2]) / 2


def most_frequent_failure(counts: NDArray[np.int64], outcomes: RunLabels) -> NDArray[np.int64]:
    """Return (rows, columns) the most frequent failure label of each cell, -1 where there is none.

    Of equally frequent ones the worst.
    """
    failures = len(outcomes.names) - (STABLE in outcomes.names)
    if not failures:
        return np.full(counts.shape[:2], -1)
    failed = counts[..., :failures]
    return np.where(failed.any(axis=-1), failed.argmax(axis=-1), -1)


def most_informative_axes(axes: Sequence[GridAxis], outcomes: RunLabels) -> MapAxes | None:
    """Return the two axes that tell most about which label a run gets; None without axes.

    The second is the one that adds most to the first. The one with more values lies across.
    """
    usable = [axis for axis in axes if axis.name != SEED] or list(axes)
    if not usable:
        return None
    first = max(
        usable, key=lambda axis: (_explained_variance(axis.codes, outcomes), len(axis.words))
    )
    others = [axis for axis in usable if axis is not first]
    if not others:
        return MapAxes(first, None)
    second = max(
        others,
        key=lambda axis: (
            _explained_variance(MapAxes(axis, first).cells, outcomes),
            len(axis.words),
        ),
    )
    x, y = sorted((first, second), key=lambda axis: -len(axis.words))
    return MapAxes(x, y)


def _explained_variance(cells: Codes, outcomes: RunLabels) -> float:
    """Return how much of the variance of labels lies between cells, adjusted for their number."""
    _, places = np.unique(cells, return_inverse=True)
    runs = np.bincount(places)
    labels = len(outcomes.names)
    counts = np.bincount(places * labels + outcomes.codes, minlength=len(runs) * labels)
    within = len(cells) - float((counts.reshape(-1, labels) ** 2 / runs[:, None]).sum())
    total = len(cells) - float((np.array(outcomes.counts) ** 2).sum()) / len(cells)
    freedom = max(1, len(cells) - len(runs)) / max(1, len(cells) - 1)
    return round(1 - within / total / freedom, 9) if total > 0 else 0.0


MOST_AXES = 8


def aggregated_axes(axes: Sequence[GridAxis]) -> tuple[GridAxis, ...]:
    """Return the axes over which sums are made: of very many the first ones, the seed last."""
    return tuple(sorted(axes, key=lambda axis: axis.name == SEED)[:MOST_AXES])


def aggregated_columns(
    axes: Sequence[GridAxis], outcomes: RunLabels, quantities: Sequence[Quantity]
) -> dict[str, NDArray[Any]]:
    """Return the columns that hold the maps over every two axes, and over each alone.

    They are called `sum:X:Y:labels` and `sum:X:Y:QUANTITY:STATISTIC`, X and Y being the places of
    the axes, and Y empty for one axis.
    """
    planes = dict(_planes(axes))
    found: dict[str, NDArray[Any]] = {
        f"{name}:labels": packed_integers(label_counts(plane, outcomes).ravel())
        for name, plane in planes.items()
    }
    cells = {name: plane.cells.astype(np.uint16) for name, plane in planes.items()}
    for quantity in quantities:
        order = np.argsort(quantity.values)[: int(np.isfinite(quantity.values).sum())]
        for name, plane in planes.items():
            size = plane.shape[0] * plane.shape[1]
            three = statistics(cells[name], size, quantity, order)
            for kind, values in zip(STATISTICS, three, strict=True):
                found[f"{name}:{quantity.name}:{kind}"] = rounded_floats(values)
    return found


def _planes(axes: Sequence[GridAxis]) -> Iterator[tuple[str, MapAxes]]:
    for place, axis in enumerate(axes):
        yield f"sum:{place}:", MapAxes(axis, None)
    for (first, x), (second, y) in combinations(enumerate(axes), 2):
        yield f"sum:{first}:{second}", MapAxes(x, y)


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
