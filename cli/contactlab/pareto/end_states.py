"""Finds configurations that end elsewhere than the most accurate one of the same model.

An error per window may be small while a body falls to the other side. Such a run is stable, and
fast, and another result.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.pareto.configurations import EvaluatedConfiguration, GroupedRuns, Rows, StoredRuns
from contactlab.rendering.amounts import format_amount
from contactlab.schema.evidence import Setting

END_COLUMNS = ("drop", "drift", "penetration_max")
"""Columns that are compared: how far free bodies move, and the depth of contacts."""
_DISCRETIZATION = frozenset(
    ("timestep", "integrator", "solver", "iterations", "ls_iterations", "tolerance", "ls_tolerance")
)
"""Knobs that compute one model differently, so that it should end alike."""


class _Ends(NamedTuple):
    """Cases of a configuration (n,), sorted, with their (n,) distances [m] by column."""

    cases: Rows
    distances: dict[str, Floats]
    depths: Floats


def mark_ends(
    evaluated: Sequence[EvaluatedConfiguration], runs: StoredRuns, groups: GroupedRuns
) -> list[EvaluatedConfiguration]:
    """Return the configurations, with how those end that end elsewhere than the most accurate.

    They are compared with the most accurate feasible one of the same model, case by case. Distances
    differ if the median difference exceeds a tenth of the larger one and the depths of contacts.
    """
    models: dict[tuple[tuple[str, Setting], ...], list[int]] = {}
    for place, each in enumerate(evaluated):
        if each.summary.feasible and each.summary.error is not None:
            key = tuple(item for item in each.values.items() if item[0] not in _DISCRETIZATION)
            models.setdefault(key, []).append(place)
    marked = list(evaluated)
    # The only configuration of a model ends like itself.
    compared = [places for places in models.values() if len(places) > 1]
    ends = _read_ends(runs, groups, [place for places in compared for place in places])
    for places in compared:
        finest = min(places, key=lambda place: evaluated[place].summary.error or 0.0)
        for place in places:
            difference = _describe_difference(ends[place], ends[finest])
            summary = evaluated[place].summary.model_copy(update={"ends_elsewhere": difference})
            marked[place] = replace(evaluated[place], summary=summary)
    return marked


def _read_ends(runs: StoredRuns, groups: GroupedRuns, places: Sequence[int]) -> dict[int, _Ends]:
    if not places:
        return {}
    case = np.zeros(len(groups.order), np.int64)
    for column in (*runs.scenarios.values(), runs.seeds):
        case = case * len(column.values) + column.codes
    columns = {name: runs.numbers[name] for name in END_COLUMNS if name in runs.numbers}
    members = groups.split_values(groups.order)
    ends = dict[int, _Ends]()
    for place in places:
        own_runs = members[place][np.argsort(case[members[place]], kind="stable")]
        own = {name: np.asarray(column)[own_runs] for name, column in columns.items()}
        depths = own.pop("penetration_max", np.zeros(len(own_runs)))
        ends[place] = _Ends(case[own_runs], own, np.nan_to_num(depths))
    return ends


def _describe_difference(here: _Ends, finest: _Ends) -> str:
    # Both have all cases, since both are feasible, but may have some more than once.
    if not np.array_equal(here.cases, finest.cases):
        return ""
    for name, distances in here.distances.items():
        other = finest.distances[name]
        both_finite = np.isfinite(distances) & np.isfinite(other)
        if not both_finite.any():
            continue
        alike = 0.1 * np.maximum(abs(distances), abs(other)) + here.depths + finest.depths
        excess = np.where(both_finite, abs(distances - other) - alike, -np.inf)
        if np.median(excess[both_finite]) > 0:
            worst = int(excess.argmax())
            ours, theirs = format_amount(distances[worst], "m"), format_amount(other[worst], "m")
            return f"{name} {ours} instead of {theirs}"
    return ""
