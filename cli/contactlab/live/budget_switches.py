"""Rows of an error budget as changes of a run's model that a reader can switch on and off."""

import copy
import math
from collections.abc import Iterator

import mujoco

from contactlab.modifications.catalogue import list_rows
from contactlab.modifications.modification import Row
from contactlab.rendering.amounts import format_percent
from contactlab.schema.error_budget import BudgetReport, BudgetRow

_NOT_EXERCISED = "not exercised"


def rows_of(report: BudgetReport) -> Iterator[tuple[Row, str]]:
    """Yield the rows of a budget, with the largest share first, and the effect of each in words."""
    worst: dict[str, BudgetRow] = {}
    for row in (row for phase in report.phases for row in phase.rows):
        if row.name not in worst or _share_size(row) > _share_size(worst[row.name]):
            worst[row.name] = row
    large_rows = [row for row in list_rows() if row.name in worst]
    for row in sorted(large_rows, key=lambda row: -_share_size(worst[row.name])):
        yield row, _effect_text(worst[row.name])


def switched_models(model: mujoco.MjModel, row: Row) -> Iterator[tuple[str, mujoco.MjModel]]:
    """Yield each change of a row, by its name, in a copy of a model."""
    names = [row.name] if len(row.changes) == 1 else [f"{row.name}, more", f"{row.name}, less"]
    for name, change in zip(names, row.changes, strict=True):
        switched = copy.copy(model)
        if row.both is not None:
            row.both(switched, model)
        change(switched, model)
        yield name, switched


def _share_size(row: BudgetRow) -> float:
    """Return a row's share; infinity if the engine failed, -1 if it is not exercised."""
    if not row.exercised:
        return -1.0
    return math.inf if row.error is None else row.error


def _effect_text(row: BudgetRow) -> str:
    if not row.exercised:
        return _NOT_EXERCISED
    if row.error is None:
        return "ends it"
    smallest_share = 1e-4  # smaller ones are not worth their digits
    if row.error < smallest_share:
        return f"< {format_percent(smallest_share)}"
    return format_percent(row.error)
