"""Recomputes rows of a store: their settings and ids, and their verdicts.

Rows with equal axes are resolved once, whatever their seeds.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from contactlab.errors import ContactlabError
from contactlab.plan.grid import Plan
from contactlab.run.run_verdicts import judge_expectations, within_tolerances
from contactlab.run.stored_runs import canonical_values, differing_id_text
from contactlab.scene.scene import Scene
from contactlab.schema.evidence import Accuracy
from contactlab.store.arrow_values import number_array, numpy_array, text_scalar
from contactlab.store.finished_store import Store
from contactlab.store.row_checks import equal_values, is_null
from contactlab.store.run_columns import select_rows
from contactlab.store.runs_table import compute_digests
from contactlab.store.table_layout import AXES_COLUMN

_RESOLVED_COLUMNS = ("run_id", "seed", "duration", "axis_names", "settings")
_VERDICT_COLUMNS = ("labels", "expected", "expectation_met", "expectation_reason", "tolerances_met")


class RowGroups:
    """Some rows, grouped by equal axes and durations."""

    def __init__(self, rows: pa.RecordBatch) -> None:
        """Group the rows, which have at least their ids, axes and durations."""
        self._rows = rows
        axes = rows[AXES_COLUMN.name]
        codes = _equality_codes(compute_digests("binary_join", axes, text_scalar("\n")))
        for name in ("duration", *{*compute_digests("list_flatten", axes).to_pylist()}):
            codes = _dense_codes(codes * (len(rows) + 1) + _equality_codes(rows[name]))
        _, firsts, group = np.unique(codes, return_index=True, return_inverse=True)
        self._firsts, self._group = firsts, group

    @property
    def names(self) -> list[str]:
        """The columns that the rows have."""
        return self._rows.schema.names

    @cached_property
    def ids(self) -> list[str]:
        """The ids of the runs."""
        return self.column_values("run_id")

    @property
    def firsts(self) -> list[int]:
        """The first row of each group."""
        return self._firsts.tolist()

    @property
    def groups(self) -> list[int]:
        """The group of each row."""
        return self._group.tolist()

    def iterate_groups(self) -> Iterator[list[int]]:
        """Yield the rows of each group."""
        order = np.argsort(self._group, kind="stable")
        for rows in np.split(order, np.cumsum(np.bincount(self._group))[:-1]):
            yield rows.tolist()

    def axes_of_row(self, row: int) -> dict[str, Any]:
        """Return the axis values of a row."""
        return {name: self.value_at(name, row) for name in self.value_at(AXES_COLUMN.name, row)}

    def value_at(self, name: str, row: int) -> Any:  # noqa: ANN401 - of the column's type
        """Return the value of a row in a column."""
        return self._rows[name][row].as_py()

    def column_values(self, name: str) -> list[Any]:
        """Return a column."""
        return self._rows[name].to_pylist()

    def select_columns(self, names: Sequence[str]) -> list[dict[str, Any]]:
        """Return some columns, row by row."""
        if not names:
            return [{} for _ in self.ids]
        return self._rows.select([*names]).to_pylist()

    def differing_rows(self, name: str) -> NDArray[np.bool_]:
        """Return (n,) whether rows differ from their group's first in a column of structs."""
        first, found = number_array(self._firsts[self._group]), np.zeros(len(self._rows), bool)
        for entry in self._rows[name].flatten():
            found |= ~equal_values(entry, compute_digests("take", entry, first))
        return found


def _equality_codes(column: pa.Array) -> NDArray[np.int64]:
    """Return (n,) numbers up to n that are equal if values are equal to the bit."""
    if pa.types.is_string(column.type):
        encode = pc.DictionaryEncodeOptions("encode")
        indices = compute_digests("dictionary_encode", column, options=encode).indices
        return numpy_array(indices).astype(np.int64)
    values = numpy_array(column)
    bits = values.view(np.int64) if values.dtype.kind == "f" else values
    return np.where(is_null(column), 0, 1 + _dense_codes(bits))


def _dense_codes(codes: NDArray[Any]) -> NDArray[np.int64]:
    return np.unique(codes, return_inverse=True)[1].astype(np.int64)


def recomputed_rows(
    store: Store, scene: Scene, plan: Plan | None, chosen: NDArray[np.bool_] | None
) -> Iterator[str]:
    """Yield differences of ids and settings of chosen runs (runs,), or all, from recomputed ones.

    With a plan, also yield runs with a stored verdict that its expectations contradict.
    """
    columns = store.columns
    judged = (
        () if plan is None else (*_VERDICT_COLUMNS, *_verdict_inputs(plan, columns.schema.names))
    )
    names = dict.fromkeys((*_RESOLVED_COLUMNS, *columns.axis_names, *judged))
    for rows in select_rows(columns.batches([*names]), chosen):
        alike = RowGroups(rows)
        yield from _differing_runs(alike, scene)
        if plan is not None:
            yield from _differing_verdicts(alike, scene, plan)


def _differing_runs(alike: RowGroups, scene: Scene) -> Iterator[str]:
    """Yield the runs that resolve to other ids or settings."""
    differs = alike.differing_rows("settings")
    seeds, durations = alike.column_values("seed"), alike.column_values("duration")
    for members in alike.iterate_groups():
        first = members[0]
        try:
            values = canonical_values(scene, alike.axes_of_row(first))
            own = [seeds[row] for row in members]
            runs = list(scene.plan_runs(values, own, durations[first]))
        except ContactlabError as error:
            yield from (f"run {alike.ids[row]}: {error}" for row in members)
            continue
        stored, again = (
            _stored_settings(alike.value_at("settings", first)),
            _stored_settings(runs[0].values),
        )
        for row, run in zip(members, runs, strict=True):
            if run.run_id != alike.ids[row]:
                yield differing_id_text(alike.ids[row], run.run_id)
            else:
                of_row = (
                    _stored_settings(alike.value_at("settings", row)) if differs[row] else stored
                )
                for name in sorted({*of_row, *again}):
                    old, new = of_row.get(name), again.get(name)
                    if old != new:
                        yield f"run {run.run_id}: {name} is {old}, not {new}"


def _stored_settings(settings: Mapping[str, Any]) -> dict[str, object]:
    return {
        name: [*value] if isinstance(value, tuple) else value
        for name, value in settings.items()
        if value is not None
    }


def _verdict_inputs(plan: Plan, names: Sequence[str]) -> list[str]:
    """Return the numeric columns that decide the verdicts of a plan's runs."""
    asked = {name for _, expectation in plan.expected for name in expectation.metrics}
    tolerances = plan.sweep.tolerances
    errors = Accuracy.model_fields if tolerances.keys() & Accuracy.model_fields.keys() else ()
    return [name for name in names if name in asked or name in tolerances or name in errors]


def _differing_verdicts(alike: RowGroups, scene: Scene, plan: Plan) -> Iterator[str]:
    """Yield the runs with a stored verdict that the sweep's expectations contradict."""
    expected: list[list[Any]] = []
    for first in alike.firsts if plan.expected else ():
        values = canonical_values(scene, alike.axes_of_row(first))
        expected.append([each for match, each in plan.expected if match.is_met(values)])
    measured = alike.select_columns(_verdict_inputs(plan, alike.names))
    verdicts = alike.select_columns(_VERDICT_COLUMNS)
    for run, group, numbers, said in zip(alike.ids, alike.groups, measured, verdicts, strict=True):
        verdict = judge_expectations(expected[group] if expected else (), said["labels"], numbers)
        found = said["expected"] and tuple(said["expected"])
        if verdict != (found, said["expectation_met"], said["expectation_reason"]):
            yield f"run {run}: its stored verdict contradicts the expectations of the sweep"
        within = within_tolerances(plan.sweep.tolerances, _without_missing_errors(numbers))
        if within != said["tolerances_met"]:
            yield f"run {run}: tolerances_met contradicts its metrics"


def _without_missing_errors(numbers: Mapping[str, float | None]) -> Mapping[str, float | None]:
    """Return the measured values of a run, without errors if it has none of them."""
    errors = numbers.keys() & Accuracy.model_fields.keys()
    if any(numbers[name] is not None for name in errors):
        return numbers
    return {name: number for name, number in numbers.items() if name not in errors}
