"""Cells of a map, with labels or one number in each."""

from collections.abc import Sequence
from itertools import combinations
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats
from contactlab.page.packing import packed_integers, rounded_floats
from contactlab.reporting.map_axes import MapAxes
from contactlab.reporting.report_columns import SEED, STABLE, GridAxis, Quantity, RunLabels

Statistic = Literal["worst", "median", "mean"]
STATISTICS: tuple[Statistic, ...] = ("worst", "median", "mean")
_MOST_AXES = 8


def label_counts(axes: MapAxes, labels: RunLabels) -> NDArray[np.int64]:
    """Return (rows, columns, labels) how many runs have which worst label."""
    count = len(labels.names)
    combined = axes.cells * count + labels.codes
    return np.bincount(combined, minlength=axes.size * count).reshape(*axes.shape, count)


def cell_statistic(axes: MapAxes, quantity: Quantity, kind: Statistic) -> Floats:
    """Return (rows, columns) one statistic of a quantity over the runs of each cell."""
    ascending = ascending_runs(quantity)
    own, values = axes.cells[ascending], quantity.values[ascending]
    counts = np.bincount(own, minlength=axes.size)
    statistics = cell_statistics(own, values, counts, quantity.column.better)
    return statistics[STATISTICS.index(kind)].reshape(axes.shape)


def ascending_runs(quantity: Quantity) -> NDArray[np.intp]:
    """Return (m,) the runs that have a value, the least first."""
    return np.argsort(quantity.values)[: int(np.isfinite(quantity.values).sum())]


def cell_statistics(
    own: NDArray[np.integer], values: Floats, counts: NDArray[np.int64], better: str
) -> Floats:
    """Return (3, cells) worst, median and mean of values in each cell, NaN where it has none.

    The worst is the largest magnitude, or the least value of a quantity of which more is better.
    One sort of the values serves every pair of axes: a stable sort of these by cell, which is
    linear in time for small integers, leaves each cell's values in order. Values (m,) are the least
    first; `own` (m,) is the cell of each, and `counts` (cells,) how many a cell has.
    """
    size = len(counts)
    grouped, sums = _grouped(own, values, size)
    filled = counts > 0
    number = counts[filled]
    ends = counts.cumsum()[filled]
    starts = ends - number
    low, high = grouped[starts], grouped[ends - 1]
    worst = low if better == "higher" else np.maximum(np.abs(low), np.abs(high))
    middle = grouped[starts + (number - 1) // 2], grouped[starts + number // 2]
    median = (middle[0] + middle[1]) / 2
    mean = sums[filled] / number
    statistics = np.full((3, size), np.nan)
    statistics[:, filled] = worst, median, mean
    return statistics


def _grouped(own: NDArray[np.integer], values: Floats, size: int) -> tuple[Floats, Floats]:
    """Return values (m,) cell by cell, in order in each, and the sum of each cell (size,)."""
    grouped = values[np.argsort(own, kind="stable")] if _differ(values) else values
    return grouped, np.bincount(own, values, minlength=size).astype(np.float64)


def _differ(values: Floats) -> bool:
    """Return whether values in order differ; equal ones, as of what never happens, need no sort."""
    return len(values) > 0 and bool(values[0] < values[-1])


def most_frequent_failure(counts: NDArray[np.int64], labels: RunLabels) -> NDArray[np.int64]:
    """Return (rows, columns) the most frequent failure label of each cell, -1 where there is none.

    Of equally frequent ones the worst.
    """
    failures = len(labels.names) - (STABLE in labels.names)
    if not failures:
        return np.full(counts.shape[:2], -1)
    failed = counts[..., :failures]
    return np.where(failed.any(axis=-1), failed.argmax(axis=-1), -1)


def aggregated_axes(axes: Sequence[GridAxis]) -> tuple[GridAxis, ...]:
    """Return the axes that runs are aggregated over: the first eight, the seed last."""
    return tuple(sorted(axes, key=lambda axis: axis.name == SEED)[:_MOST_AXES])


def aggregated_columns(
    axes: Sequence[GridAxis], labels: RunLabels, quantities: Sequence[Quantity]
) -> dict[str, NDArray[Any]]:
    """Return the cells of every map that a page can show, in place of too many runs.

    They are called `cells:X:Y:labels` and `cells:X:Y:QUANTITY:STATISTIC`, X and Y being the
    positions of the axes, and Y empty for a map of a single row.
    """
    maps = {f"cells:{index}:": MapAxes(axis, None) for index, axis in enumerate(axes)}
    for (first, x), (second, y) in combinations(enumerate(axes), 2):
        maps[f"cells:{first}:{second}"] = MapAxes(x, y)
    columns: dict[str, NDArray[Any]] = {}
    runs: dict[str, NDArray[np.int64]] = {}
    for name, codes_of_map in maps.items():
        counts = label_counts(codes_of_map, labels)
        columns[f"{name}:labels"] = packed_integers(counts.ravel())
        runs[name] = counts.sum(axis=-1).ravel()
    codes = {axis.name: packed_integers(axis.codes) for axis in axes}
    for quantity in quantities:
        ascending = ascending_runs(quantity)
        values = quantity.values[ascending]
        own = {name: code[ascending] for name, code in codes.items()}
        for name, codes_of_map in maps.items():
            # The smaller the numbers, the sooner they are sorted.
            kind = np.min_scalar_type(codes_of_map.size)
            cells = own[codes_of_map.x.name].astype(kind)
            if codes_of_map.y is not None:
                cells += np.multiply(
                    own[codes_of_map.y.name], len(codes_of_map.x.ticks), dtype=kind
                )
            is_whole = len(values) == len(quantity.values)
            counts = runs[name] if is_whole else np.bincount(cells, minlength=codes_of_map.size)
            found = cell_statistics(cells, values, counts, quantity.column.better)
            for statistic, numbers in zip(STATISTICS, found, strict=True):
                columns[f"{name}:{quantity.name}:{statistic}"] = rounded_floats(numbers)
    return columns
