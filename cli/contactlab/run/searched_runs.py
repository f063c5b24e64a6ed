"""The runs of a sweep that searches for the worst of a metric."""

from collections import defaultdict
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from contactlab.plan.grid import Plan
from contactlab.plan.search import coordinates, next_trials, searched_axes
from contactlab.run.chosen_runs import ChosenRuns
from contactlab.schema.sweep_schema import Search


class SearchedRuns(ChosenRuns):
    """Trials of each seed, and of all values of the axes that are not searched."""

    def __init__(self, search: Search, plan: Plan, ids: NDArray[np.uint64]) -> None:
        """Take the points of a plan, and (runs) the ids of its runs in order."""
        metric = search.maximise or search.minimise
        assert metric is not None
        super().__init__(ids, lambda row: row.get(metric), (metric,))
        self._sign, self._most = -1.0 if search.maximise else 1.0, search.runs
        place_on = {name: coordinates(plan.sweep, name) for name in searched_axes(plan.sweep)}
        places = defaultdict[object, dict[int, tuple[float, ...]]](dict)
        for run in plan.runs():
            point = tuple(place(run.values.get(name)) for name, place in place_on.items())
            shared = tuple(item for item in run.values.items() if item[0] not in place_on)
            places[*shared, run.seed][run.index] = point
        self._searches = [
            (list(points), np.array([*points.values()])) for points in places.values()
        ]

    def choose(self) -> Iterator[int]:
        """Yield the places of the runs to make next."""
        for places, points in self._searches:
            measured = self._measured(places)
            for trial in next_trials(points, measured, self._sign, self._most):
                yield places[trial]

    def _measured(self, places: list[int]) -> Mapping[int, float | None]:
        found = dict[int, float | None]()
        for point, place in enumerate(places):
            if self.is_known(place):
                value = self.side_at(place)
                found[point] = float(value) if isinstance(value, float | int) else None
        return found
