"""The runs of a sweep that refines a grid."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from contactlab.measure import labels_with
from contactlab.plan.grid import Plan
from contactlab.plan.refined_axes import first_stride
from contactlab.plan.refinement import (
    UNKNOWN,
    Codes,
    Lattice,
    corners_of,
    group_lattices,
    halve_cells,
    next_points,
)
from contactlab.plan.sides import fields_read_by, side_of
from contactlab.run.chosen_runs import ChosenRuns
from contactlab.run.planned_runs import RunIndex
from contactlab.schema.evidence import WholeGrid
from contactlab.schema.sweep_schema import Refine


class RefinedRuns(ChosenRuns):
    """Runs in cells with differing outcomes, and runs that are in no cell."""

    def __init__(self, refine: Refine, plan: Plan, ids: NDArray[np.uint64]) -> None:
        """Take the grid of a plan, and the ids (runs) of its runs in order."""
        side = side_of(refine.where, labels_with("required"))
        super().__init__(ids, side, fields_read_by(refine.where))
        self._probe, self._codes = refine.probe, dict[object, int]()
        self._axes = {name: plan.grid.product_values(name) for name in refine.axes}
        stride = first_stride(refine)
        assert stride is not None
        self._stride = stride
        runs = ((run.index, run.values, run.seed) for run in plan.iterate_runs())
        self._lattices = group_lattices(runs, self._axes)
        outside = np.ones(len(ids), bool)
        for lattice in self._lattices:
            outside[lattice.places[lattice.places != UNKNOWN]] = False
        self._apart: list[int] = np.flatnonzero(outside).tolist()

    def choose_next(self) -> Iterator[int]:
        """Yield the plan indices of the next runs.

        The first are also the runs in no cell, such as baselines and runs that a file includes.
        """
        yield from (place for place in self._apart if not self.is_known(place))
        for lattice in self._lattices:
            points = next_points(
                self._side_codes(lattice), self._stride, self._probe, lattice.ranks
            )
            yield from lattice.places[points].tolist()

    def _side_codes(self, lattice: Lattice) -> Codes:
        """Return (n, ...) the sides of a lattice's points; those without a run have another one."""
        codes = [self._side_code(place) for place in lattice.places.ravel().tolist()]
        return np.array(codes, np.int32).reshape(lattice.places.shape)

    def _side_code(self, place: int) -> int:
        if place != UNKNOWN and not self.is_known(place):
            return UNKNOWN
        side = "no run" if place == UNKNOWN else ("side", self.side_at(place))
        return self._codes.setdefault(side, len(self._codes))

    def describe_grid(self, index: RunIndex) -> WholeGrid:
        """Return the grid, with the size of its inferred part."""
        points = probes = 0
        for lattice in self._lattices:
            codes = self._side_codes(lattice)
            inside = ~corners_of(halve_cells(codes, self._stride).cells, codes.shape)
            points += int(inside.sum())
            probes += int((inside & (codes != UNKNOWN)).sum())
        known = {"axes": self._axes, "inside": points, "probes": probes}
        return super().describe_grid(index).model_copy(update=known)
