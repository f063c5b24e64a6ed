"""Runs of a sweep that stops when a share of them is known well enough."""

from collections import defaultdict
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from contactlab.measure import labels_with
from contactlab.plan.grid import Plan
from contactlab.plan.sampled_shares import configuration_of
from contactlab.plan.sides import counts_for_share, fields_read_by
from contactlab.run.chosen_runs import ChosenRuns
from contactlab.schema.sweep_schema import Until
from contactlab.shares import anytime

# Runs of each configuration before the first check, and the divisor for later increases.
_FIRST_RUNS, _GROWTH_DIVISOR = 16, 4


class RunsUntilKnown(ChosenRuns):
    """The first runs of each configuration, in the order of the plan, until its share is known."""

    def __init__(self, until: Until, plan: Plan, ids: NDArray[np.uint64]) -> None:
        """Take the draws of a plan, and the ids (runs) of its runs in order."""
        side = counts_for_share(until.share, labels_with("required"))
        super().__init__(ids, side, fields_read_by(until.share))
        self._until = until
        drawn = plan.sweep.drawn_axes
        self._places = defaultdict[object, list[int]](list)
        for run in plan.iterate_runs():
            self._places[configuration_of(run.values, drawn)].append(run.index)

    def choose_next(self) -> Iterator[int]:
        """Yield the plan indices of the next runs."""
        for places in self._places.values():
            yield from self._next_runs(places)

    def _next_runs(self, places: list[int]) -> list[int]:
        count = min(_FIRST_RUNS, len(places))
        while True:
            missing = [place for place in places[:count] if not self.is_known(place)]
            if missing or count == len(places):
                return missing
            good = sum(self.side_at(place) is True for place in places[:count])
            low, high = anytime(good, count, self._until.sure)
            if (high - low) / 2 <= self._until.half_width:
                return []
            count = min(len(places), count + max(_FIRST_RUNS, count // _GROWTH_DIVISOR))
