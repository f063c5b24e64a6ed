"""The axes of maps, and the choice of the most informative ones."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from contactlab.reporting.report_columns import SEED, Codes, GridAxis, RunLabels


def split_blocks(runs: int) -> Iterator[slice]:
    """Yield the places of `runs` runs, some at a time."""
    block = 1 << 20  # runs with cells in memory at once
    for first in range(0, runs, block):
        yield slice(first, min(runs, first + block))


@dataclass(frozen=True)
class MapAxes:
    """The two axes of a map over n runs; one without a vertical axis has a single row."""

    x: GridAxis
    y: GridAxis | None

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return (1 if self.y is None else len(self.y.ticks), len(self.x.ticks))

    @property
    def size(self) -> int:
        """Number of cells."""
        return self.shape[0] * self.shape[1]

    @property
    def cells(self) -> Codes:
        """(n,) the cell of each run, row by row, in as few bytes as hold it."""
        cells = np.empty(len(self.x.codes), np.min_scalar_type(self.size))
        for runs in split_blocks(len(cells)):
            cells[runs] = self.cells_of(runs)
        return cells

    def cells_of(self, runs: slice) -> Codes:
        """Return (m,) the cells of some runs."""
        x = self.x.codes[runs].astype(np.int64)
        return x if self.y is None else x + self.y.codes[runs].astype(np.int64) * len(self.x.ticks)

    def count_codes(self, codes: Codes | NDArray[np.bool_], count: int) -> NDArray[np.int64]:
        """Return (cells, count) the number of runs of each cell with each of codes (n,)."""
        counts = np.zeros(self.size * count, np.int64)
        for runs in split_blocks(len(codes)):
            combined = self.cells_of(runs) * count + codes[runs]
            counts += np.bincount(combined, minlength=len(counts))
        return counts.reshape(self.size, count)

    @property
    def firsts(self) -> NDArray[np.int64]:
        """The first run of each cell that has any."""
        first_runs = np.full(self.size, -1)
        for runs in split_blocks(len(self.x.codes)):
            cells, places = np.unique(self.cells_of(runs), return_index=True)
            is_new = first_runs[cells] < 0
            first_runs[cells[is_new]] = runs.start + places[is_new]
        return first_runs[first_runs >= 0]

    @property
    def names(self) -> tuple[str, ...]:
        """The axes' names, the horizontal one first."""
        return tuple(axis.name for axis in (self.x, self.y) if axis)


def most_informative_axes(axes: Sequence[GridAxis], labels: RunLabels) -> MapAxes | None:
    """Return the two axes that separate stable runs and labels best; None without axes.

    The one with more values is horizontal.
    """
    usable = [axis for axis in axes if axis.name != SEED] or list(axes)
    pairs = [
        MapAxes(*sorted(pair, key=lambda axis: -len(axis.ticks)))
        for pair in combinations(usable, 2)
    ] or [MapAxes(axis, None) for axis in usable]
    return max(pairs, key=lambda pair: (_measure_separation(pair, labels), pair.size), default=None)


def axes_named(axes: Sequence[GridAxis], names: Sequence[str]) -> MapAxes | None:
    """Return the axes of one or two names as those of a map; None unless all differ in runs."""
    chosen_axes = [axis for name in names for axis in axes if axis.name == name]
    return (
        MapAxes(chosen_axes[0], chosen_axes[1] if len(chosen_axes) > 1 else None)
        if len(chosen_axes) == len(names)
        else None
    )


def by_importance(axes: Sequence[GridAxis], labels: RunLabels) -> list[GridAxis]:
    """Return axes, first those with values that separate stable runs and labels best."""
    return sorted(axes, key=lambda axis: -_measure_separation(MapAxes(axis, None), labels))


def _measure_separation(axes: MapAxes, labels: RunLabels) -> float:
    """Return the variance of failures and of labels that cells explain."""
    failed = _explained_variance(axes, labels.failed, 2)
    return round(failed + _explained_variance(axes, labels.codes, len(labels.names)), 6)


def _explained_variance(axes: MapAxes, codes: Codes | NDArray[np.bool_], count: int) -> float:
    """Return the share of the variance of codes below a count, adjusted for the number of cells."""
    counts = axes.count_codes(codes, count)
    counts = counts[counts.any(axis=1)]
    runs = counts.sum(axis=1)
    within = len(codes) - float((counts**2 / runs[:, None]).sum())
    total = len(codes) - float((counts.sum(axis=0) ** 2).sum()) / len(codes)
    freedom = max(1, len(codes) - len(runs)) / max(1, len(codes) - 1)
    return 1 - within / total / freedom if total > 0 else 0.0
