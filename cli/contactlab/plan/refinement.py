"""Grids that are refined: cells whose corners differ are halved, others are inferred.

The grid is the same as that of a sweep that runs all of it; refining chooses which of its runs are
made. A cell is a box of grid points. It is halved while any of its points that ran differ, until it
has a side of one step. Some of the points within uniform cells run too, drawn at random: a cell in
which one differs is halved as well.
"""

import math
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Codes = NDArray[np.int32]
Mask = NDArray[np.bool_]
UNKNOWN = -1


class Cell(NamedTuple):
    """A box of grid points: its first corner, and of how many steps its sides are."""

    origin: tuple[int, ...]
    steps: int

    @property
    def box(self) -> tuple[slice, ...]:
        """Its points, of an array of the grid."""
        return tuple(slice(first, first + self.steps + 1) for first in self.origin)

    @property
    def corners(self) -> tuple[slice, ...]:
        """Its corners, likewise."""
        return tuple(slice(first, first + self.steps + 1, self.steps) for first in self.origin)


class Halved(NamedTuple):
    """Cells as far as the points known allow, and the points that halving them further needs."""

    cells: tuple[Cell, ...]
    needed: Mask


def halved(codes: Codes, stride: int) -> Halved:
    """Halve the cells of a grid whose known points differ.

    Args:
        codes: (n, ...) what came of each point, `UNKNOWN` where it did not run; n is one more than
            a multiple of the stride, along each of the axes.
        stride: steps of the cells to begin with, a power of two.
    """
    needed = np.zeros(codes.shape, bool)
    coarse = (slice(None, None, stride),) * codes.ndim
    needed[coarse] = codes[coarse] == UNKNOWN
    origins = product(*(range(0, count - 1, stride) for count in codes.shape))
    waiting, cells = [Cell(origin, stride) for origin in origins], list[Cell]()
    while waiting:
        cell = waiting.pop()
        box, half = codes[cell.box], cell.steps // 2
        known = box[box != UNKNOWN]
        if not half or (known == known[:1]).all():
            cells.append(cell)
            continue
        middle = (slice(None, None, half),) * codes.ndim
        if (box[middle] == UNKNOWN).any():
            needed[cell.box][middle] |= box[middle] == UNKNOWN
            cells.append(cell)
        else:
            starts = product(*((first, first + half) for first in cell.origin))
            waiting += [Cell(start, half) for start in starts]
    return Halved(tuple(cells), needed)


def filled(codes: Codes, cells: Iterable[Cell]) -> Codes:
    """Return what comes of each point: as it came, or as of the uniform cell that it lies in."""
    found = codes.copy()
    for cell in cells:
        box = found[cell.box]
        known = box[box != UNKNOWN]
        if known.size and (known == known[0]).all():
            box[...] = known[0]
    return found


def corners_of(cells: Iterable[Cell], shape: tuple[int, ...]) -> Mask:
    """Return which points of a grid are corners of cells."""
    found = np.zeros(shape, bool)
    for cell in cells:
        found[cell.corners] = True
    return found


def next_points(codes: Codes, stride: int, probe: float, ranks: NDArray[np.intp]) -> Mask:
    """Return the points to run next, none of which is known; none at all once a grid is refined.

    Which points are chosen in the end depends on nothing but what comes of each, so that neither
    the order in which runs finish nor an interruption changes it; and so do not those known that
    refining did not ask for.

    Args:
        codes: (n, ...) as of `halved`.
        stride: likewise.
        probe: how many points within uniform cells are to run, as a share of the cells' corners.
        ranks: (n, ...) in which order such points are chosen.
    """
    seen = np.zeros(codes.shape, bool)
    while True:
        found = halved(np.where(seen, codes, UNKNOWN), stride)
        asked = found.needed
        if not asked.any():
            asked = _probes(seen, corners_of(found.cells, codes.shape), probe, ranks)
        if not asked.any():
            return asked
        seen |= asked
        if (missing := seen & (codes == UNKNOWN)).any():
            return missing


def _probes(seen: Mask, corners: Mask, share: float, ranks: NDArray[np.intp]) -> Mask:
    """Return the further points within uniform cells that are due."""
    made, due = int((seen & ~corners).sum()), math.ceil(share * int(corners.sum()))
    chosen = np.zeros(seen.shape, bool)
    free = np.flatnonzero(~seen)
    first = free[np.argsort(ranks.flat[free])[: max(0, due - made)]]
    chosen.flat[first] = True
    return chosen


def missed(points: int, probes: int, island: int) -> float:
    """Return how probable it is that no probe meets an island of some points within uniform cells.

    Probes are drawn without replacement from that many points, so that the number that meet the
    island is hypergeometric: C(points - island, probes) / C(points, probes).
    """
    if island > points - probes:
        return 0.0
    odds = (math.log1p(-probes / (points - place)) for place in range(island))
    return math.exp(sum(odds))


def least_met(points: int, probes: int, sure: float = 0.95) -> int | None:
    """Return the least island that probes meet with some probability; None if none is."""
    if not probes:
        return None
    low, high = 0, points - probes + 1
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if missed(points, probes, middle) <= 1 - sure else (middle, high)
    return high


@dataclass(frozen=True)
class Lattice:
    """The points of a grid that only the refined axes tell apart: of one seed, and all else equal.

    Attributes:
        shared: the values of the other axes.
        seed: likewise.
        places: (n, ...) which run each point is; UNKNOWN where there is none.
    """

    shared: Mapping[str, object]
    seed: int
    places: NDArray[np.int64]

    @property
    def ranks(self) -> NDArray[np.intp]:
        """(n, ...) the order in which its probes are drawn, another for each lattice."""
        named = repr((sorted(self.shared.items()), self.seed))
        drawn = np.random.default_rng(zlib.crc32(named.encode()))
        return drawn.permutation(self.places.size).reshape(self.places.shape)


def lattices(
    runs: Iterable[tuple[int, Mapping[str, object], int]], axes: Mapping[str, Sequence[object]]
) -> list[Lattice]:
    """Return the lattices of runs: place, settings by axis, and seed of each.

    Runs that lie on none of the axes' values, as those a file includes, belong to none.
    """
    steps = [{value: step for step, value in enumerate(values)} for values in axes.values()]
    shape = tuple(map(len, steps))
    found = dict[object, Lattice]()
    for place, values, seed in runs:
        point = [step.get(values.get(name)) for name, step in zip(axes, steps, strict=True)]
        if None in point:
            continue
        shared = {name: value for name, value in values.items() if name not in axes}
        key = *shared.items(), seed
        if key not in found:
            found[key] = Lattice(shared, seed, np.full(shape, UNKNOWN, np.int64))
        found[key].places[tuple(point)] = place
    return [*found.values()]
