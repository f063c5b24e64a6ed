"""Rows of a store, recomputed: what they are resolved to again, and how they are judged again.

Rows whose axes are equal are resolved once, whatever their seeds.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactlab.errors import ContactlabError
from contactlab.plan.grid import Plan
from contactlab.run.run_verdicts import judge, within_tolerances
from contactlab.run.stored_runs import another_id, canonical_values
from contactlab.scene.scene import Scene
from contactlab.schema.evidence import Accuracy
from contactlab.store.alike_rows import AlikeRows
from contactlab.store.finished_store import Store
from contactlab.store.run_columns import chosen_rows

_RESOLVED = ("run_id", "seed", "duration", "axis_names", "settings")
_JUDGED = ("labels", "expected", "expectation_met", "expectation_reason", "tolerances_met")


def recomputed_rows(
    store: Store, scene: Scene, plan: Plan | None, chosen: NDArray[np.bool_] | None
) -> Iterator[str]:
    """Yield where ids and settings of the runs chosen (runs,), or all, are not as resolved again.

    With a plan, yield too where they do not meet, or miss, what it expects of them as they say.
    """
    columns = store.columns
    judged = () if plan is None else (*_JUDGED, *_measured(plan, columns.schema.names))
    names = dict.fromkeys((*_RESOLVED, *columns.axis_names, *judged))
    for rows in chosen_rows(columns.batches([*names]), chosen):
        alike = AlikeRows(rows)
        yield from _other_runs(alike, scene)
        if plan is not None:
            yield from _other_verdicts(alike, scene, plan)


def _other_runs(alike: AlikeRows, scene: Scene) -> Iterator[str]:
    """Yield which runs are resolved to other ids or settings."""
    differs = alike.differs("settings")
    seeds, durations = alike.values("seed"), alike.values("duration")
    for members in alike.members():
        first = members[0]
        try:
            values = canonical_values(scene, alike.axes(first))
            own = [seeds[row] for row in members]
            runs = list(scene.planned(values, own, durations[first]))
        except ContactlabError as error:
            yield from (f"run {alike.ids[row]}: {error}" for row in members)
            continue
        stored, again = _known(alike.value("settings", first)), _known(runs[0].values)
        for row, run in zip(members, runs, strict=True):
            if run.run_id != alike.ids[row]:
                yield another_id(alike.ids[row], run.run_id)
            else:
                of_row = _known(alike.value("settings", row)) if differs[row] else stored
                yield from _other_settings(alike.ids[row], of_row, again)


def _other_settings(
    run: str, stored: Mapping[str, object], again: Mapping[str, object]
) -> Iterator[str]:
    if stored != again:
        for name in sorted({*stored, *again}):
            if again.get(name) != stored.get(name):
                yield f"run {run}: {name} is {stored.get(name)}, not {again.get(name)}"


def _known(settings: Mapping[str, Any]) -> dict[str, object]:
    """Return settings as the table has them, without those that are null."""
    return {
        name: [*value] if isinstance(value, tuple) else value
        for name, value in settings.items()
        if value is not None
    }


def _measured(plan: Plan, names: Sequence[str]) -> list[str]:
    """Return the columns of numbers that the verdicts of a plan's runs are of."""
    asked = {name for _, expectation in plan.expected for name in expectation.metrics}
    tolerances = plan.sweep.tolerances
    errors = Accuracy.model_fields if tolerances.keys() & Accuracy.model_fields.keys() else ()
    return [name for name in names if name in asked or name in tolerances or name in errors]


def _other_verdicts(alike: AlikeRows, scene: Scene, plan: Plan) -> Iterator[str]:
    """Yield which runs do not meet, or miss, what the sweep expects of them as they say."""
    expected: list[list[Any]] = []
    for first in alike.firsts if plan.expected else ():
        values = canonical_values(scene, alike.axes(first))
        expected.append([each for match, each in plan.expected if match.holds(values)])
    measured = alike.table(_measured(plan, alike.names))
    verdicts = alike.table(_JUDGED)
    for run, group, numbers, said in zip(alike.ids, alike.groups, measured, verdicts, strict=True):
        verdict = judge(expected[group] if expected else (), said["labels"], numbers)
        found = said["expected"] and tuple(said["expected"])
        if verdict != (found, said["expectation_met"], said["expectation_reason"]):
            yield f"run {run}: what it says of expectations is not what the sweep expects"
        within = within_tolerances(plan.sweep.tolerances, _known_errors(numbers))
        if within != said["tolerances_met"]:
            yield f"run {run}: tolerances_met is not what its metrics give"


def _known_errors(numbers: Mapping[str, float | None]) -> Mapping[str, float | None]:
    """Return what was measured of a run, without its errors where it has none of them."""
    errors = numbers.keys() & Accuracy.model_fields.keys()
    if any(numbers[name] is not None for name in errors):
        return numbers
    return {name: number for name, number in numbers.items() if name not in errors}
