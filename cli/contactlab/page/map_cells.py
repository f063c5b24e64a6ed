"""Cells of a map, with labels or one number in each."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats
from contactlab.page.packing import packed_integers, rounded_floats
from contactlab.reporting.map_axes import MapAxes, split_blocks
from contactlab.reporting.report_columns import (
    SEED,
    STABLE,
    Codes,
    GridAxis,
    Quantity,
    RunLabels,
)

Statistic = Literal["worst", "median", "mean"]
STATISTICS: tuple[Statistic, ...] = ("worst", "median", "mean")
_PART, _MOST_PARTS = 4096, 1024
"""Least number of values of a part, besides four for each cell, and largest number of parts."""


def label_counts(axes: MapAxes, labels: RunLabels) -> NDArray[np.int64]:
    """Return (rows, columns, labels) the number of runs with each worst label."""
    count = len(labels.names)
    return axes.count_codes(labels.codes, count).reshape(*axes.shape, count)


def cell_statistic(axes: MapAxes, quantity: Quantity, kind: Statistic) -> Floats:
    """Return (rows, columns) one statistic of a quantity over the runs of each cell."""
    ascending = ascending_runs(quantity)
    own, values = axes.cells[ascending], quantity.values[ascending]
    sums = _sum_places(own, values, axes.size)
    statistics = cell_statistics(own, values, sums, quantity.column.better)
    return statistics[STATISTICS.index(kind)].reshape(axes.shape)


def ascending_runs(quantity: Quantity) -> NDArray[np.intp]:
    """Return (m,) the runs that have a value, the least first."""
    return np.argsort(quantity.values)[: int(np.isfinite(quantity.values).sum())]


def cell_statistics(own: NDArray[np.integer], values: Floats, sums: Floats, better: str) -> Floats:
    """Return (3, cells) worst, median and mean of values in each cell, NaN without values.

    The worst is the largest magnitude, or the least value if more is better.
    Values (m,) are the least first, for all maps alike; `own` (m,) is the cell of each, and `sums`
    (cells,) the sum of each cell's values.
    """
    size = len(sums)
    parts = int(np.clip(len(own) // (_PART + 4 * size), 1, _MOST_PARTS))
    ends = np.linspace(0, len(own), parts + 1).astype(np.intp)
    counts = np.stack([np.bincount(own[a:b], minlength=size) for a, b in pairwise(ends)])
    runs = counts.sum(axis=0)
    filled = np.flatnonzero(runs)
    statistics = np.full((3, size), np.nan)
    if not len(filled):
        return statistics
    number = runs[filled]
    places = np.stack([0 * number, (number - 1) // 2, number // 2, number - 1])
    low, *middle, high = _pick_values(own, values, ends, counts, filled, places)
    worst = low if better == "higher" else np.maximum(np.abs(low), np.abs(high))
    statistics[:, filled] = worst, (middle[0] + middle[1]) / 2, sums[filled] / number
    return statistics


def _pick_values(
    own: NDArray[np.integer],
    values: Floats,
    ends: NDArray[np.intp],
    counts: NDArray[np.intp],
    filled: NDArray[np.intp],
    places: NDArray[np.intp],
) -> Floats:
    """Return (k, f) the values at these places (k, f) of each filled cell (f,).

    Values (m,) ascend, and are in parts with these ends (p + 1,). The count of each cell in each
    part (p, cells) gives the part of a place. Only such parts are searched, and only their cells.
    """
    if not values[0] < values[-1]:
        return np.full(places.shape, values[0])
    before = np.vstack([np.zeros_like(counts[:1]), counts.cumsum(axis=0)])
    part = np.stack([(before[1:, filled] <= place).sum(axis=0) for place in places])
    picked_values = np.empty(places.shape)
    for each in np.unique(part).tolist():
        kinds, cells = np.nonzero(part == each)
        is_wanted = np.zeros(counts.shape[1], np.bool_)
        is_wanted[filled[cells]] = True
        inside = own[ends[each] : ends[each + 1]]
        rows = np.flatnonzero(is_wanted[inside])
        # Stable, and linear in time for small integers: each cell's values stay in order.
        rows = rows[np.argsort(inside[rows], kind="stable")]
        starts = np.where(is_wanted, counts[each], 0)
        starts = starts.cumsum() - starts - before[each]
        chosen = rows[starts[filled[cells]] + places[kinds, cells]]
        picked_values[kinds, cells] = values[ends[each] + chosen]
    return picked_values


def most_frequent_failure(counts: NDArray[np.int64], labels: RunLabels) -> NDArray[np.int64]:
    """Return (rows, columns) the most frequent failure label of each cell, -1 without one.

    If several are equally frequent, it is the worst.
    """
    failures = len(labels.names) - (STABLE in labels.names)
    if not failures:
        return np.full(counts.shape[:2], -1)
    failed = counts[..., :failures]
    return np.where(failed.any(axis=-1), failed.argmax(axis=-1), -1)


def aggregated_axes(axes: Sequence[GridAxis]) -> tuple[GridAxis, ...]:
    """Return the axes that runs are aggregated over: the first eight, the seed last."""
    most_axes = 8
    return tuple(sorted(axes, key=lambda axis: axis.name == SEED)[:most_axes])


def aggregated_columns(
    axes: Sequence[GridAxis], labels: RunLabels, quantities: Iterable[Quantity]
) -> dict[str, NDArray[Any]]:
    """Return the cells of every map that a page can show, in place of too many runs.

    They are called `cells:X:Y:labels` and `cells:X:Y:QUANTITY:STATISTIC`, X and Y being the
    positions of the axes, and Y empty for a map of a single row.
    """
    maps = {f"cells:{index}:": MapAxes(axis, None) for index, axis in enumerate(axes)}
    for (first, x), (second, y) in combinations(enumerate(axes), 2):
        maps[f"cells:{first}:{second}"] = MapAxes(x, y)
    counts = {name: label_counts(map_axes, labels) for name, map_axes in maps.items()}
    columns = {f"{name}:labels": packed_integers(each.ravel()) for name, each in counts.items()}
    for quantity in quantities:
        values, better = quantity.values, quantity.column.better
        # If some run has no value, this is NaN, which equals nothing.
        if values.min() == values.max():
            runs = ((name, each.sum(axis=-1).ravel()) for name, each in counts.items())
            statistics_by_name = (
                (name, _of_one_value(own, values[0], better)) for name, own in runs
            )
        else:
            statistics_by_name = _of_maps(maps, axes, quantity)
        for name, statistics in statistics_by_name:
            for statistic, numbers in zip(STATISTICS, statistics, strict=True):
                columns[f"{name}:{quantity.name}:{statistic}"] = rounded_floats(numbers)
    return columns


def _of_one_value(runs: NDArray[np.int64], value: np.float64, better: str) -> Floats:
    """Return (3, cells) the result of `cell_statistics` if all runs (cells,) have one value."""
    worst = value if better == "higher" else abs(value)
    return np.where(runs > 0, np.array([[worst], [value], [value]]), np.nan)


def _of_maps(
    maps: Mapping[str, MapAxes], axes: Sequence[GridAxis], quantity: Quantity
) -> Iterator[tuple[str, Floats]]:
    """Yield the statistics (3, cells) of each map."""
    ascending = ascending_runs(quantity)
    values = quantity.values[ascending]
    codes = {axis.name: axis.codes[ascending] for axis in axes}
    del ascending
    sums = _GridSums.of(axes, codes, values)
    for name, map_axes in maps.items():
        # The smaller the numbers, the sooner they are counted and sorted.
        kind = np.min_scalar_type(map_axes.size)
        cells = codes[map_axes.x.name].astype(kind)
        if map_axes.y is not None:
            cells += codes[map_axes.y.name].astype(kind) * kind.type(len(map_axes.x.ticks))
        of_cells = sums.of_map(map_axes, cells)
        yield name, cell_statistics(cells, values, of_cells, quantity.column.better)


def _sum_places(places: NDArray[np.integer], values: Floats, size: int) -> Floats:
    """Return (size,) the sum of the values (m,) at each place (m,)."""
    sums = np.zeros(size)
    for part in split_blocks(len(values)):
        sums += np.bincount(places[part], values[part], minlength=size)
    return sums


@dataclass(frozen=True)
class _GridSums:
    """Sums of values over the grid of the smallest axes; most maps are sums of these."""

    values: Floats
    axes: tuple[GridAxis, ...]
    grid: Floats  # (ticks of each axis, ...)

    @classmethod
    def of(cls, axes: Sequence[GridAxis], own: Mapping[str, Codes], values: Floats) -> "_GridSums":
        """Return the sums of values (m,) with codes (m,) by axis."""
        present_axes, size = list[GridAxis](), 1
        runs_of_a_sum = 8  # runs for each place of a grid of sums; maps with fewer are summed alone
        for axis in sorted(axes, key=lambda axis: len(axis.ticks)):
            size *= len(axis.ticks)
            if runs_of_a_sum * size > len(values):
                break
            present_axes.append(axis)
        shape = [len(axis.ticks) for axis in present_axes]
        places = np.zeros(len(values), np.int32)
        for axis in present_axes:
            places *= np.int32(len(axis.ticks))
            places += own[axis.name].astype(np.int32)
        return cls(
            values,
            tuple(present_axes),
            _sum_places(places, values, int(np.prod(shape))).reshape(shape),
        )

    def of_map(self, map_axes: MapAxes, cells: NDArray[np.integer]) -> Floats:
        """Return (cells,) the sums of a map, from the cell of each value."""
        own_axes = [axis for axis in (map_axes.y, map_axes.x) if axis is not None]
        names = [axis.name for axis in self.axes]
        if any(axis.name not in names for axis in own_axes):
            return _sum_places(cells, self.values, map_axes.size)
        axis_places = [names.index(axis.name) for axis in own_axes]
        rest = tuple(place for place in range(len(names)) if place not in axis_places)
        sums = self.grid.sum(axis=rest)
        return (sums.T if axis_places != sorted(axis_places) else sums).ravel()
