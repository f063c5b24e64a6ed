"""What lies in each cell of a heatmap: counts of labels, or one number."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import Floats
from contactlab.report.grid import SEED, Codes, GridAxis
from contactlab.report.outcomes import STABLE, Outcomes
from contactlab.report.quantities import Quantity

Statistic = Literal["worst", "median", "mean"]
STATISTICS: tuple[Statistic, ...] = ("worst", "median", "mean")


@dataclass(frozen=True)
class Plane:
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


def label_counts(plane: Plane, outcomes: Outcomes) -> NDArray[np.int64]:
    """Return (rows, columns, labels) how many runs have which worst label."""
    labels, size = len(outcomes.names), plane.shape[0] * plane.shape[1]
    places = plane.cells * labels + outcomes.codes
    return np.bincount(places, minlength=size * labels).reshape(*plane.shape, labels)


def statistic(plane: Plane, quantity: Quantity, kind: Statistic) -> Floats:
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


def main_failure(counts: NDArray[np.int64], outcomes: Outcomes) -> NDArray[np.int64]:
    """Return (rows, columns) the most frequent failure label of each cell, -1 where there is none.

    Of equally frequent ones the worst.
    """
    failures = len(outcomes.names) - (STABLE in outcomes.names)
    if not failures:
        return np.full(counts.shape[:2], -1)
    failed = counts[..., :failures]
    return np.where(failed.any(axis=-1), failed.argmax(axis=-1), -1)


def telling_plane(axes: Sequence[GridAxis], outcomes: Outcomes) -> Plane | None:
    """Return the two axes that tell most about which label a run gets; None without axes.

    The second is the one that adds most to the first. The one with more values lies across.
    """
    usable = [axis for axis in axes if axis.name != SEED] or list(axes)
    if not usable:
        return None
    first = max(usable, key=lambda axis: (_told(axis.codes, outcomes), len(axis.words)))
    others = [axis for axis in usable if axis is not first]
    if not others:
        return Plane(first, None)
    second = max(
        others, key=lambda axis: (_told(Plane(axis, first).cells, outcomes), len(axis.words))
    )
    x, y = sorted((first, second), key=lambda axis: -len(axis.words))
    return Plane(x, y)


def _told(cells: Codes, outcomes: Outcomes) -> float:
    """Return how much of the variance of labels lies between cells, adjusted for their number."""
    _, places = np.unique(cells, return_inverse=True)
    runs = np.bincount(places)
    labels = len(outcomes.names)
    counts = np.bincount(places * labels + outcomes.codes, minlength=len(runs) * labels)
    within = len(cells) - float((counts.reshape(-1, labels) ** 2 / runs[:, None]).sum())
    total = len(cells) - float((np.array(outcomes.counts) ** 2).sum()) / len(cells)
    freedom = max(1, len(cells) - len(runs)) / max(1, len(cells) - 1)
    return round(1 - within / total / freedom, 9) if total > 0 else 0.0
