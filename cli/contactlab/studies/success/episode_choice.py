"""Chooses the episodes to play: block by block, until the question is decided."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactlab.plan.grid import Plan
from contactlab.run.chosen_runs import ChosenRuns
from contactlab.scene.variants import AS_WRITTEN
from contactlab.schema.vocabulary import VARIANT
from contactlab.studies.success.episode_table import Case, EpisodeTable

FIRST_BLOCK = 10
"""Cases before the first look; the object is found in them."""
_GROWTH_DIVISOR = 4  # later blocks grow with a quarter of all cases so far

FinishedEpisode = tuple[Case, str, Mapping[str, Any]]
"""The case of a finished run, its variant, and its row."""


class EpisodesUntilDecided(ChosenRuns):
    """The episodes of a block of cases as written, then their variants, then the next block.

    Args:
        plan: the plan of all episodes.
        ids: (runs) of its runs in order.
        tabulate: returns the table of all rows of finished episodes.
        is_decided: whether the table answers the question.
        control: the variant that is played only if another one of numerics changes an outcome.
    """

    def __init__(
        self,
        plan: Plan,
        ids: NDArray[np.uint64],
        tabulate: Callable[[Iterable[FinishedEpisode]], EpisodeTable],
        is_decided: Callable[[EpisodeTable], bool],
        control: str | None,
    ) -> None:
        super().__init__(ids, dict, ())
        self._tabulate, self._is_decided, self._control = tabulate, is_decided, control
        self._cases = dict[Case, dict[str, int]]()
        for run in plan.iterate_runs():
            values = {**run.values, "seed": run.seed}
            variant = str(values.pop(VARIANT, AS_WRITTEN))
            self._cases.setdefault(case_of(values), {})[variant] = run.index

    def choose_next(self) -> Iterable[int]:
        """Return the plan indices of the next episodes."""
        cases, count = [*self._cases.values()], 0
        while count < len(cases):
            count = min(len(cases), count + max(FIRST_BLOCK, count // _GROWTH_DIVISOR))
            block = cases[:count]
            for missing in (self._missing_written(block), self._missing_variants(block)):
                if missing:
                    return missing
            table = self._tabulate(self._finished_episodes(count))
            if missing := self._missing_controls(count, table):
                return missing
            if self._is_decided(table):
                break
        return []

    def _finished_episodes(self, count: int) -> Iterable[FinishedEpisode]:
        for case, places in [*self._cases.items()][:count]:
            for variant, place in places.items():
                row = self.side_at(place)
                if isinstance(row, dict):
                    yield case, variant, row

    def _missing_written(self, block: Sequence[Mapping[str, int]]) -> list[int]:
        return [each[AS_WRITTEN] for each in block if not self.is_known(each[AS_WRITTEN])]

    def _missing_variants(self, block: Sequence[Mapping[str, int]]) -> list[int]:
        return [
            place
            for each in block
            for variant, place in each.items()
            if variant not in (AS_WRITTEN, self._control) and not self.is_known(place)
        ]

    def _missing_controls(self, count: int, table: EpisodeTable) -> list[int]:
        """Return the episodes of the control: of all cases, once a variant changed an outcome."""
        if self._control is None or not changes_outcomes(table):
            return []
        places = [each[self._control] for each in [*self._cases.values()][:count]]
        return [place for place in places if not self.is_known(place)]


def changes_outcomes(table: EpisodeTable) -> bool:
    """Return whether any variant of numerics changes an outcome."""
    counts = map(table.count_outcomes, table.numerics)
    return any(each.gained or each.lost for each in counts)


def case_of(values: Mapping[str, object]) -> Case:
    """Return the case of a run: its axes without the variant, and its seed."""
    return tuple(sorted((name, str(value)) for name, value in values.items() if name != VARIANT))
