"""Runs of a plan that are chosen by the results of earlier runs: refining, searching, counting."""

import math
from abc import ABC, abstractmethod
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic_core import from_json

from contactlab.measure import labels_with
from contactlab.plan.grid import Plan
from contactlab.plan.refinement import (
    UNKNOWN,
    Codes,
    Lattice,
    corners_of,
    first_stride,
    group_lattices,
    halve_cells,
    next_points,
)
from contactlab.plan.sampled_shares import configuration_of
from contactlab.plan.search import Trials, axis_coordinates, searched_axes
from contactlab.plan.sides import Side, counts_for_share, fields_read_by, side_of
from contactlab.run.planned_runs import RunIndex
from contactlab.run.tasks import FinishedRun, Purpose
from contactlab.schema.evidence import SweepIdentity, WholeGrid
from contactlab.schema.sweep_schema import Refine, Search, Until
from contactlab.shares import anytime_interval


class ChosenRuns(ABC):
    """Chooses the next runs of a plan from the results of earlier ones.

    The choice depends on nothing else, so neither the order of finished runs nor an interruption
    changes it.

    Attributes:
        purpose: of the next runs; for another than `record`, their results are notes.
    """

    purpose: Purpose = "record"

    def __init__(self, ids: NDArray[np.uint64], side: Side, read_by: tuple[str, ...]) -> None:
        """Take the ids (runs) of a plan, and the function that classifies rows by some fields."""
        self.ids, self.read_by = ids, read_by
        self._side = side
        self.known = dict[int, object]()
        """The side of each finished run, by its id."""

    def add_rows(self, rows: Iterable[Mapping[str, Any]]) -> None:
        """Add the rows of finished runs."""
        self.known |= {int(row["run_id"], 16): self._side(row) for row in rows}

    def learn_finished(self, finished: Collection[FinishedRun]) -> None:
        """Add finished runs, as workers return them."""
        self.add_rows({**from_json(one.shared or b"{}"), **from_json(one.row)} for one in finished)

    def learn_notes(self, notes: Mapping[str, Mapping[str, Any]]) -> None:  # noqa: B027
        """Add the results of runs that were not recorded, by run id."""

    def next_runs(self) -> NDArray[np.bool_]:
        """Return (runs) a mask of the next runs, all unknown; empty once enough are known."""
        is_chosen = np.zeros(len(self.ids), bool)
        is_chosen[[*self.choose_next()]] = True
        return np.isin(self.ids, self.ids[is_chosen])

    @abstractmethod
    def choose_next(self) -> Iterable[int]:
        """Yield the plan indices of the next runs."""

    def is_known(self, place: int) -> bool:
        """Return whether the run at a plan index has finished."""
        return int(self.ids[place]) in self.known

    def side_at(self, place: int) -> object:
        """Return the side of the run at a plan index; None if it has not finished."""
        return self.known.get(int(self.ids[place]))

    def describe_grid(self, index: RunIndex) -> WholeGrid:
        """Return the description of the whole grid."""
        return WholeGrid(runs=len(index))

    def finished_part(
        self, index: RunIndex, identity: SweepIdentity
    ) -> tuple[RunIndex, SweepIdentity]:
        """Return the index of the finished runs, and the identity of a store of them."""
        finished_ids = np.fromiter(self.known, np.uint64, len(self.known))
        part = index.select_ids(np.isin(index.ids, finished_ids))
        own = {"runs_asked": len(part), "whole": self.describe_grid(index)}
        return part, identity.model_copy(update=own)


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
        grid_fields = {"axes": self._axes, "inside": points, "probes": probes}
        return super().describe_grid(index).model_copy(update=grid_fields)


class RunsUntilKnown(ChosenRuns):
    """The first runs of each configuration, in the order of the plan, until its share is known."""

    def __init__(self, until: Until, plan: Plan, ids: NDArray[np.uint64]) -> None:
        """Take the draws of a plan, and the ids (runs) of its runs in order."""
        side = counts_for_share(until.share, labels_with("required"))
        super().__init__(ids, side, fields_read_by(until.share))
        self._until = until
        drawn_axes = plan.sweep.drawn_axes
        self._places = defaultdict[object, list[int]](list)
        for run in plan.iterate_runs():
            self._places[configuration_of(run.values, drawn_axes)].append(run.index)

    def choose_next(self) -> Iterator[int]:
        """Yield the plan indices of the next runs."""
        for places in self._places.values():
            yield from self._next_runs(places)

    def _next_runs(self, places: list[int]) -> list[int]:
        # Runs of each configuration before the first check, and the divisor for later increases.
        first_runs, growth_divisor = 16, 4
        count = min(first_runs, len(places))
        while True:
            missing = [place for place in places[:count] if not self.is_known(place)]
            if missing or count == len(places):
                return missing
            good = sum(self.side_at(place) is True for place in places[:count])
            low, high = anytime_interval(good, count, self._until.sure)
            if (high - low) / 2 <= self._until.half_width:
                return []
            count = min(len(places), count + max(first_runs, count // growth_divisor))


class SearchedRuns(ChosenRuns):
    """Trials for each seed, and for each combination of axes that are not searched.

    Rows that a file includes outside of the axes' values are not trials: they run unchanged.
    """

    def __init__(self, search: Search, plan: Plan, ids: NDArray[np.uint64]) -> None:
        """Take the points of a plan, and the ids (runs) of its runs in order."""
        metric = search.metric
        super().__init__(ids, lambda row: row.get(metric), (metric,))
        sign = -1.0 if search.maximise else 1.0
        place_on = {
            name: axis_coordinates(plan.sweep.axes[name], plan.grid.product_values(name))
            for name in searched_axes(plan.sweep)
        }
        places, self._apart = defaultdict[object, dict[int, tuple[float, ...]]](dict), list[int]()
        for run in plan.iterate_runs():
            point = tuple(place(run.values.get(name)) for name, place in place_on.items())
            if any(map(math.isnan, point)):
                self._apart.append(run.index)
                continue
            shared = tuple(item for item in run.values.items() if item[0] not in place_on)
            places[*shared, run.seed][run.index] = point
        self._searches = [
            (list(points), Trials(np.array([*points.values()]), sign, search.runs))
            for points in places.values()
        ]

    def choose_next(self) -> Iterator[int]:
        """Yield the plan indices of the next runs."""
        yield from (place for place in self._apart if not self.is_known(place))
        for places, trials in self._searches:
            results = dict[int, float | None]()
            for point, place in enumerate(places):
                if self.is_known(place):
                    value = self.side_at(place)
                    results[point] = float(value) if isinstance(value, float | int) else None
            for trial in trials.next_points(results):
                yield places[trial]
