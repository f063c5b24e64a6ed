"""Rows of an error budget as changes of a run's model that a reader turns on and off."""

import copy
import math
from collections.abc import Iterator

import mujoco

from contactlab.budget import ROWS
from contactlab.budget.rows import Row
from contactlab.budget.verdict import percent
from contactlab.schema.error_budget import BudgetReport, BudgetRow

_NEVER = "not exercised"
_LEAST = 1e-4


def rows_of(report: BudgetReport) -> Iterator[tuple[Row, str]]:
    """Yield the rows of a budget, the largest share first, and what the budget says of each."""
    worst: dict[str, BudgetRow] = {}
    for row in (row for phase in report.phases for row in phase.rows):
        if row.name not in worst or _size(row) > _size(worst[row.name]):
            worst[row.name] = row
    found = [row for row in ROWS if row.name in worst]
    for row in sorted(found, key=lambda row: -_size(worst[row.name])):
        yield row, _told(worst[row.name])


def switched(model: mujoco.MjModel, row: Row) -> Iterator[tuple[str, mujoco.MjModel]]:
    """Yield each change of a row, by its name, in a copy of a model."""
    names = [row.name] if len(row.changes) == 1 else [f"{row.name}, more", f"{row.name}, less"]
    for name, change in zip(names, row.changes, strict=True):
        made = copy.copy(model)
        if row.both is not None:
            row.both(made, model)
        change(made, model)
        yield name, made


def _size(row: BudgetRow) -> float:
    """Return a row's share; infinity where the engine gave up, -1 if it is not exercised."""
    if not row.exercised:
        return -1.0
    return math.inf if row.share is None else row.share


def _told(row: BudgetRow) -> str:
    if not row.exercised:
        return _NEVER
    if row.share is None:
        return "ends it"
    return percent(row.share) if row.share >= _LEAST else f"< {percent(_LEAST)}"
