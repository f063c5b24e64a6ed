"""Runs of a sweep that searches for the worst value of a metric."""

import math
from collections import defaultdict
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from contactlab.plan.grid import Plan
from contactlab.plan.search import Trials, axis_coordinates, searched_axes
from contactlab.run.chosen_runs import ChosenRuns
from contactlab.schema.sweep_schema import Search


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
            found = dict[int, float | None]()
            for point, place in enumerate(places):
                if self.is_known(place):
                    value = self.side_at(place)
                    found[point] = float(value) if isinstance(value, float | int) else None
            for trial in trials.next_points(found):
                yield places[trial]
