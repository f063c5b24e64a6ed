"""Grids that are refined: cells with differing corners are halved, others are inferred.

The grid equals that of a sweep with all its runs; refining chooses the runs to simulate. A cell is
a box of grid points. It is halved while any of its simulated points differ, until its sides are one
step long. Some random points within uniform cells are simulated too: a cell with a differing point
is halved as well.
"""

import math
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactlab.schema.sweep_schema import COARSE, Refine

Codes = NDArray[np.int32]
Mask = NDArray[np.bool_]
UNKNOWN = -1


class Cell(NamedTuple):
    """A box of grid points: its first corner, and the number of steps along its sides."""

    origin: tuple[int, ...]
    steps: int

    @property
    def box(self) -> tuple[slice, ...]:
        """Slices of its points in an array of the grid."""
        return tuple(slice(first, first + self.steps + 1) for first in self.origin)

    @property
    def corners(self) -> tuple[slice, ...]:
        """Slices of its corners in an array of the grid."""
        return tuple(slice(first, first + self.steps + 1, self.steps) for first in self.origin)


class HalvedCells(NamedTuple):
    """Cells as far as known points allow, and the points that further halving needs."""

    cells: tuple[Cell, ...]
    needed: Mask


def halve_cells(codes: Codes, stride: int) -> HalvedCells:
    """Halve the cells of a grid that have differing known points.

    Args:
        codes: (n, ...) outcome of each point, `UNKNOWN` for points without a run; n is one more
            than
            a multiple of the stride, along each of the axes.
        stride: steps of the first cells, a power of two.
    """
    needed = np.zeros(codes.shape, bool)
    coarse = (slice(None, None, stride),) * codes.ndim
    needed[coarse] = codes[coarse] == UNKNOWN
    origins = product(*(range(0, count - 1, stride) for count in codes.shape))
    waiting, cells = [Cell(origin, stride) for origin in origins], list[Cell]()
    while waiting:
        cell = waiting.pop()
        box, half = codes[cell.box], cell.steps // 2
        known_codes = box[box != UNKNOWN]
        if not half or (known_codes == known_codes[:1]).all():
            cells.append(cell)
            continue
        middle = (slice(None, None, half),) * codes.ndim
        if (box[middle] == UNKNOWN).any():
            needed[cell.box][middle] |= box[middle] == UNKNOWN
            cells.append(cell)
        else:
            starts = product(*((first, first + half) for first in cell.origin))
            waiting += [Cell(start, half) for start in starts]
    return HalvedCells(tuple(cells), needed)


def infer_codes(codes: Codes, cells: Iterable[Cell]) -> Codes:
    """Return the outcome of each point: its own, or that of the uniform cell around it."""
    inferred = codes.copy()
    for cell in cells:
        box = inferred[cell.box]
        known_codes = box[box != UNKNOWN]
        if known_codes.size and (known_codes == known_codes[0]).all():
            box[...] = known_codes[0]
    return inferred


def corners_of(cells: Iterable[Cell], shape: tuple[int, ...]) -> Mask:
    """Return a mask of the points of a grid that are corners of cells."""
    corners = np.zeros(shape, bool)
    for cell in cells:
        corners[cell.corners] = True
    return corners


def next_points(codes: Codes, stride: int, probe: float, ranks: NDArray[np.intp]) -> Mask:
    """Return the points to run next, all of them unknown; none once a grid is refined.

    The choice of points depends only on the outcome of each point, so that neither the order of
    finished runs nor an interruption changes it. Known points that refining did not request do not
    change it either.

    Args:
        codes: (n, ...) as in `halved`.
        stride: as in `halved`.
        probe: number of points to run within uniform cells, as a share of the cells' corners.
        ranks: (n, ...) order of choice of such points.
    """
    is_requested = np.zeros(codes.shape, bool)
    while True:
        halved = halve_cells(np.where(is_requested, codes, UNKNOWN), stride)
        requested = halved.needed
        if not requested.any():
            # Choose further points within uniform cells, in the order of their ranks.
            corners = corners_of(halved.cells, codes.shape)
            probed, required = (
                int((is_requested & ~corners).sum()),
                math.ceil(probe * int(corners.sum())),
            )
            requested = np.zeros(is_requested.shape, bool)
            free = np.flatnonzero(~is_requested)
            first = free[np.argsort(ranks.flat[free])[: max(0, required - probed)]]
            requested.flat[first] = True
        if not requested.any():
            return requested
        is_requested |= requested
        if (missing := is_requested & (codes == UNKNOWN)).any():
            return missing


def miss_probability(points: int, probes: int, island: int) -> float:
    """Return the probability that no probe meets an island of some points within uniform cells.

    Probes are drawn from all points without replacement, so that the number within the island is
    hypergeometric: C(points - island, probes) / C(points, probes).
    """
    if island > points - probes:
        return 0.0
    odds = (math.log1p(-probes / (points - place)) for place in range(island))
    return math.exp(sum(odds))


def smallest_detected_island(points: int, probes: int, sure: float = 0.95) -> int | None:
    """Return the smallest island that probes meet with some probability; None if none is."""
    if not probes:
        return None
    low, high = 0, points - probes + 1
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (
            (low, middle)
            if miss_probability(points, probes, middle) <= 1 - sure
            else (middle, high)
        )
    return high


@dataclass(frozen=True)
class Lattice:
    """The points of a grid that differ in refined axes only; seed and other values are equal.

    Attributes:
        shared: the values of the other axes.
        seed: the seed of all points.
        places: (n, ...) index of the run of each point; UNKNOWN without a run.
    """

    shared: Mapping[str, object]
    seed: int
    places: NDArray[np.int64]

    @property
    def ranks(self) -> NDArray[np.intp]:
        """(n, ...) the order of its probes, which differs between lattices."""
        seed_text = repr((sorted(self.shared.items()), self.seed))
        generator = np.random.default_rng(zlib.crc32(seed_text.encode()))
        return generator.permutation(self.places.size).reshape(self.places.shape)


def group_lattices(
    runs: Iterable[tuple[int, Mapping[str, object], int]], axes: Mapping[str, Sequence[object]]
) -> list[Lattice]:
    """Return the lattices of runs, from the index, settings by axis, and seed of each.

    Runs off the axes' values, such as those that a file includes, belong to none.
    """
    steps = [{value: step for step, value in enumerate(values)} for values in axes.values()]
    shape = tuple(map(len, steps))
    lattices = dict[object, Lattice]()
    for place, values, seed in runs:
        point = [step.get(values.get(name)) for name, step in zip(axes, steps, strict=True)]
        if None in point:
            continue
        shared = {name: value for name, value in values.items() if name not in axes}
        key = *shared.items(), seed
        if key not in lattices:
            lattices[key] = Lattice(shared, seed, np.full(shape, UNKNOWN, np.int64))
        lattices[key].places[tuple(point)] = place
    return [*lattices.values()]


def first_stride(refine: Refine) -> int | None:
    """Return the steps of the first cells, a power of two; None if no such cells exist."""
    steps = refine.to - 1
    if refine.start is None:
        least = steps
        while least % 2 == 0 and least // 2 >= COARSE - 1:
            least //= 2
        return steps // least
    stride, rest = divmod(steps, refine.start - 1)
    return stride if not rest and stride and not stride & (stride - 1) else None
