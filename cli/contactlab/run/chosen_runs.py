"""Runs of a plan that are chosen by the results of earlier runs."""

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
    """Chooses the next runs of a plan from the results of earlier ones.

    The choice depends on nothing else, so neither the order of finished runs nor an interruption
    changes it.
    """

    def __init__(self, ids: NDArray[np.uint64], side: Side, read_by: tuple[str, ...]) -> None:
        """Take the ids (runs) of a plan, and the function that classifies rows by some fields."""
        self.ids, self.read_by = ids, read_by
        self._side = side
        self.known = dict[int, object]()
        """The side of each finished run, by its id."""

    def add_rows(self, rows: Iterable[Mapping[str, Any]]) -> None:
        """Add the rows of finished runs."""
        self.known |= {int(row["run_id"], 16): self._side(row) for row in rows}

    def learn_finished(self, finished: Collection[Finished]) -> None:
        """Add finished runs, as workers return them."""
        self.add_rows({**from_json(one.shared or b"{}"), **from_json(one.row)} for one in finished)

    def next_runs(self) -> NDArray[np.bool_]:
        """Return (runs) a mask of the next runs, all unknown; empty once enough are known."""
        wanted = np.zeros(len(self.ids), bool)
        wanted[[*self.choose_next()]] = True
        return np.isin(self.ids, self.ids[wanted])

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
        made = np.fromiter(self.known, np.uint64, len(self.known))
        part = index.select_ids(np.isin(index.ids, made))
        own = {"runs_asked": len(part), "whole": self.describe_grid(index)}
        return part, identity.model_copy(update=own)
