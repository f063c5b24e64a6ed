"""Chooses the episodes to play: block by block, until the question is decided."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactlab.plan.grid import Plan
from contactlab.run.chosen_runs import ChosenRuns
from contactlab.scene.variants import AS_WRITTEN
from contactlab.schema.success import PlayedEpisode
from contactlab.schema.vocabulary import VARIANT
from contactlab.studies.success.episode_table import Case, EpisodeTable

FIRST_BLOCK = 10
"""Cases before the first look; the object is found in them, and costly variants are played."""

FinishedEpisode = tuple[Case, str, Mapping[str, Any]]
"""The case of a finished run, its variant, and its row."""


class EpisodesUntilDecided(ChosenRuns):
    """The episodes of a block of cases as written, then their variants, then the next block.

    Those as written are recorded, and at the end the first success that each variant takes away.
    Other episodes are played without a record, since only their outcome counts.

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
        self._values = dict[int, Mapping[str, Any]]()  # axes and seeds by place in the plan
        self._played = dict[int, Mapping[str, Any]]()  # rows of episodes without a record, by id
        for run in plan.iterate_runs():
            values = {**run.values, "seed": run.seed}
            variant = str(values.get(VARIANT, AS_WRITTEN))
            self._values[run.index] = values
            self._cases.setdefault(case_of(values), {})[variant] = run.index
        self._variants = [*next(iter(self._cases.values()))]

    def learn_notes(self, notes: Mapping[str, Mapping[str, Any]]) -> None:
        """Add the outcomes of episodes, by run id; empty ones ended their process."""
        lost = {"status": "crashed", "status_reason": "its process died", "steps": 0}
        for run_id, ended in notes.items():
            self._played[int(run_id, 16)] = {"run_id": run_id, **(ended or lost)}

    def choose_next(self) -> Iterable[int]:
        """Return the plan indices of the next episodes."""
        count, table = 0, EpisodeTable(())
        while count < len(self._cases):
            # Later blocks grow with a quarter of all cases so far.
            count = min(len(self._cases), count + max(FIRST_BLOCK, count // 4))
            if places := self._list_missing([AS_WRITTEN], count):
                self.purpose = "record"
                return places
            self.purpose = "outcomes"
            conditional = {self._control, *self._costly}
            usual = [name for name in self._variants if name not in conditional]
            first = min(count, FIRST_BLOCK)
            if places := [
                *self._list_missing(usual, count),
                *self._list_missing(self._costly, first),
            ]:
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
        self.purpose = "record"
        examples = (self._cases[case][name] for name, case in table.find_first_losses().items())
        return [place for place in examples if not self.is_known(place)]

    def iterate_unrecorded(self) -> Iterator[PlayedEpisode]:
        """Yield the outcome of each episode that was not recorded."""
        for place, values in self._values.items():
            if not self.is_known(place) and (row := self._played.get(int(self.ids[place]))):
                axes = {name: value for name, value in values.items() if name != "seed"}
                yield PlayedEpisode(axes=axes, seed=values["seed"], **row)

    def _list_missing(self, variants: Sequence[str], count: int) -> list[int]:
        cases = [*self._cases.values()][:count]
        return [
            place
            for case in cases
            for place in map(case.__getitem__, variants)
            if not self.is_known(place) and int(self.ids[place]) not in self._played
        ]

    def _finished_episodes(self, count: int) -> Iterable[FinishedEpisode]:
        for case, places in [*self._cases.items()][:count]:
            for variant, place in places.items():
                row = self.side_at(place) or self._played.get(int(self.ids[place]))
                if isinstance(row, dict):
                    yield case, variant, row


def case_of(values: Mapping[str, object]) -> Case:
    """Return the case of a run: its axes without the variant, and its seed."""
    return tuple(sorted((name, str(value)) for name, value in values.items() if name != VARIANT))
