"""The axes of maps, and which of them show most."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from contactlab.reporting.report_columns import SEED, Codes, GridAxis, RunLabels


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
        """(n,) the cell of each run, row by row."""
        rows = 0 if self.y is None else self.y.codes
        return rows * len(self.x.ticks) + self.x.codes

    @property
    def names(self) -> tuple[str, ...]:
        """The axes' names, the horizontal one first."""
        return tuple(axis.name for axis in (self.x, self.y) if axis)


def most_informative_axes(axes: Sequence[GridAxis], labels: RunLabels) -> MapAxes | None:
    """Return the two axes that part stable runs from others, and labels, best; None without axes.

    The one with more values is horizontal.
    """
    usable = [axis for axis in axes if axis.name != SEED] or list(axes)
    pairs = [
        MapAxes(*sorted(pair, key=lambda axis: -len(axis.ticks)))
        for pair in combinations(usable, 2)
    ] or [MapAxes(axis, None) for axis in usable]
    return max(pairs, key=lambda pair: (_separation(pair, labels), pair.size), default=None)


def axes_named(axes: Sequence[GridAxis], names: Sequence[str]) -> MapAxes | None:
    """Return the axes of one or two names as those of a map; None unless all differ in runs."""
    found = [axis for name in names for axis in axes if axis.name == name]
    return (
        MapAxes(found[0], found[1] if len(found) > 1 else None)
        if len(found) == len(names)
        else None
    )


def by_importance(axes: Sequence[GridAxis], labels: RunLabels) -> list[GridAxis]:
    """Return axes, those first whose values part stable runs from others, and labels, best."""
    return sorted(axes, key=lambda axis: -_separation(MapAxes(axis, None), labels))


def _separation(axes: MapAxes, labels: RunLabels) -> float:
    """Return how much of which runs fail, and of which label they get, cells explain."""
    failed = _explained_variance(axes, labels.failed.astype(np.int64), 2)
    return round(failed + _explained_variance(axes, labels.codes, len(labels.names)), 6)


def _explained_variance(axes: MapAxes, codes: Codes, count: int) -> float:
    """Return the share of the variance of codes below a count, adjusted for the number of cells."""
    counts = np.bincount(axes.cells * count + codes, minlength=axes.size * count)
    counts = counts.reshape(-1, count)
    counts = counts[counts.any(axis=1)]
    runs = counts.sum(axis=1)
    within = len(codes) - float((counts**2 / runs[:, None]).sum())
    total = len(codes) - float((counts.sum(axis=0) ** 2).sum()) / len(codes)
    freedom = max(1, len(codes) - len(runs)) / max(1, len(codes) - 1)
    return 1 - within / total / freedom if total > 0 else 0.0
