"""Recomputes rows of a store: their settings and ids, and their verdicts.

Rows with equal axes are resolved once, whatever their seeds.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactlab.errors import ContactlabError
from contactlab.plan.grid import Plan, find_expectations
from contactlab.run.run_verdicts import judge_expectations, within_tolerances
from contactlab.run.stored_runs import canonical_values, differing_id_text
from contactlab.scene.scene import Scene
from contactlab.schema.evidence import Accuracy
from contactlab.schema.sweep_schema import Expectation
from contactlab.store.finished_store import Store
from contactlab.store.rows_by_configuration import RowGroups
from contactlab.store.run_columns import select_rows

_RESOLVED_COLUMNS = ("run_id", "seed", "duration", "axis_names", "settings")
_VERDICT_COLUMNS = ("labels", "expected", "expectation_met", "expectation_reason", "tolerances_met")


def recomputed_rows(
    store: Store, scene: Scene, plan: Plan | None, chosen: NDArray[np.bool_] | None
) -> Iterator[str]:
    """Yield differences of ids and settings of chosen runs (runs,), or all, from recomputed ones.

    With a plan, also yield runs with a stored verdict that its expectations contradict.
    """
    columns = store.columns
    judged_names = (
        () if plan is None else (*_VERDICT_COLUMNS, *_verdict_inputs(plan, columns.schema.names))
    )
    names = dict.fromkeys((*_RESOLVED_COLUMNS, *columns.axis_names, *judged_names))
    for rows in select_rows(columns.iterate_batches([*names]), chosen):
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
    expected_metrics = {name for _, expectation in plan.expected for name in expectation.metrics}
    tolerances = plan.sweep.tolerances
    errors = Accuracy.model_fields if tolerances.keys() & Accuracy.model_fields.keys() else ()
    return [
        name for name in names if name in expected_metrics or name in tolerances or name in errors
    ]


def _differing_verdicts(alike: RowGroups, scene: Scene, plan: Plan) -> Iterator[str]:
    """Yield the runs with a stored verdict that the sweep's expectations contradict."""
    expected = list[list[Expectation]]()
    for first in alike.firsts if plan.expected else ():
        values = canonical_values(scene, alike.axes_of_row(first))
        expected.append(find_expectations(plan.expected, values))
    metric_values = alike.select_columns(_verdict_inputs(plan, alike.names))
    verdicts = alike.select_columns(_VERDICT_COLUMNS)
    for run, group, numbers, stored_verdict in zip(
        alike.ids, alike.groups, metric_values, verdicts, strict=True
    ):
        verdict = judge_expectations(
            expected[group] if expected else (), stored_verdict["labels"], numbers
        )
        expected_labels = stored_verdict["expected"] and tuple(stored_verdict["expected"])
        if verdict != (
            expected_labels,
            stored_verdict["expectation_met"],
            stored_verdict["expectation_reason"],
        ):
            yield f"run {run}: its stored verdict contradicts the expectations of the sweep"
        # Errors count only if the run has any.
        errors = numbers.keys() & Accuracy.model_fields.keys()
        lacks_errors = all(numbers[name] is None for name in errors)
        compared = {
            name: number
            for name, number in numbers.items()
            if not (lacks_errors and name in errors)
        }
        within = within_tolerances(plan.sweep.tolerances, compared)
        if within != stored_verdict["tolerances_met"]:
            yield f"run {run}: tolerances_met contradicts its metrics"
