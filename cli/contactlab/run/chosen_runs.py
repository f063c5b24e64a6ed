"""Runs of a plan that are chosen by what came of those before."""

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic_core import from_json

from contactlab.plan.sides import Side
from contactlab.run.planned_runs import RunIndex
from contactlab.run.tasks import Finished
from contactlab.schema.evidence import SweepIdentity, WholeGrid


class ChosenRuns(ABC):
    """Which runs of a plan to make, given what came of others.

    The choice depends on nothing else, so that neither the order in which runs finish nor an
    interruption changes it.
    """

    def __init__(self, ids: NDArray[np.uint64], side: Side, read_by: tuple[str, ...]) -> None:
        """Take (runs) the ids of a plan, and what tells runs apart, by which of their fields."""
        self.ids, self.read_by = ids, read_by
        self._side = side
        self.known = dict[int, object]()
        """The side that each run lies on that was made, by its id."""

    def learn(self, rows: Iterable[Mapping[str, Any]]) -> None:
        """Take in the rows of runs that finished."""
        self.known |= {int(row["run_id"], 16): self._side(row) for row in rows}

    def learn_finished(self, finished: Collection[Finished]) -> None:
        """Take in runs as workers return them."""
        self.learn({**from_json(one.shared or b"{}"), **from_json(one.row)} for one in finished)

    def next(self) -> NDArray[np.bool_]:
        """Return (runs) which to make next, none of which is known; no more once enough is."""
        wanted = np.zeros(len(self.ids), bool)
        wanted[[*self.choose()]] = True
        return np.isin(self.ids, self.ids[wanted])

    @abstractmethod
    def choose(self) -> Iterable[int]:
        """Yield the places of the runs to make next."""

    def is_known(self, place: int) -> bool:
        """Return whether the run at a place was made."""
        return int(self.ids[place]) in self.known

    def side_at(self, place: int) -> object:
        """Return the side that the run at a place lies on; None if it was not made."""
        return self.known.get(int(self.ids[place]))

    def whole(self, index: RunIndex) -> WholeGrid:
        """Return what is known of the whole grid."""
        return WholeGrid(runs=len(index))

    def part(self, index: RunIndex, identity: SweepIdentity) -> tuple[RunIndex, SweepIdentity]:
        """Return the index of the runs that were made, and the identity of a store of those."""
        made = np.fromiter(self.known, np.uint64, len(self.known))
        part = index.only(np.isin(index.ids, made))
        own = {"runs_asked": len(part), "whole": self.whole(index)}
        return part, identity.model_copy(update=own)
