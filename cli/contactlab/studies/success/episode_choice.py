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
COSTLY_CASES = 20
"""Cases in which a costly variant is played anyway."""
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
        control: the variant that is played only if one of numerics changes an outcome.
        costly: variants that are played in the first cases only, unless they change an outcome.
    """

    def __init__(
        self,
        plan: Plan,
        ids: NDArray[np.uint64],
        tabulate: Callable[[Iterable[FinishedEpisode]], EpisodeTable],
        is_decided: Callable[[EpisodeTable], bool],
        control: str | None = None,
        costly: Sequence[str] = (),
    ) -> None:
        super().__init__(ids, dict, ())
        self._tabulate, self._is_decided = tabulate, is_decided
        self._control, self._costly = control, costly
        self._cases = dict[Case, dict[str, int]]()
        for run in plan.iterate_runs():
            values = {**run.values, "seed": run.seed}
            variant = str(values.pop(VARIANT, AS_WRITTEN))
            self._cases.setdefault(case_of(values), {})[variant] = run.index
        self._variants = [*next(iter(self._cases.values()))]

    def choose_next(self) -> Iterable[int]:
        """Return the plan indices of the next episodes."""
        count = 0
        while count < len(self._cases):
            count = min(len(self._cases), count + max(FIRST_BLOCK, count // _GROWTH_DIVISOR))
            conditional = {self._control, *self._costly}
            usual = [name for name in self._variants if name not in conditional]
            first = min(count, COSTLY_CASES)
            for places in (
                self._list_missing([AS_WRITTEN], count),
                [*self._list_missing(usual, count), *self._list_missing(self._costly, first)],
            ):
                if places:
                    return places
            table = self._tabulate(self._finished_episodes(count))
            further = [name for name in self._costly if table.count_outcomes(name).changed_outcomes]
            if self._control and any(
                table.count_outcomes(each).changed_outcomes for each in table.numerics
            ):
                further.append(self._control)
            if places := self._list_missing(further, count):
                return places
            if self._is_decided(table):
                break
        return []

    def _list_missing(self, variants: Sequence[str], count: int) -> list[int]:
        cases = [*self._cases.values()][:count]
        places = [case[name] for case in cases for name in variants]
        return [place for place in places if not self.is_known(place)]

    def _finished_episodes(self, count: int) -> Iterable[FinishedEpisode]:
        for case, places in [*self._cases.items()][:count]:
            for variant, place in places.items():
                row = self.side_at(place)
                if isinstance(row, dict):
                    yield case, variant, row


def case_of(values: Mapping[str, object]) -> Case:
    """Return the case of a run: its axes without the variant, and its seed."""
    return tuple(sorted((name, str(value)) for name, value in values.items() if name != VARIANT))
