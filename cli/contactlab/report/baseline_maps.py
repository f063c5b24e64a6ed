"""A store beside its baseline: what compare says, and where the two differ."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import altair as alt
import numpy as np
from numpy.typing import NDArray

from contactlab.compare import DEFAULT_POLICY, Pairing, compare, pair_stores
from contactlab.report.heatmap import (
    MapFrame,
    label_map,
    label_rows,
    number_map,
    number_rows,
    ratio_map,
)
from contactlab.report.map_cells import MapAxes, cell_statistic, label_counts
from contactlab.report.report_columns import (
    STABLE_COLOUR,
    Quantity,
    RunLabels,
    read_quantities,
    read_run_labels,
)
from contactlab.report.report_data import ReportData
from contactlab.report.vega_rendering import themed
from contactlab.schema import Check, CheckOutcome, ComparePolicy, ComparisonReport
from contactlab.store import Store
from contactlab.tradeoff import COLOURS

_WORSE, _BETTER, _SAME = 0, 1, 2
_THIRD = 300, 260
_DEPTH = "penetration_max"
_TOLD: tuple[CheckOutcome, ...] = ("failed", "warned", "noted")
Rows = NDArray[np.intp]
Spec = dict[str, Any]


@dataclass(frozen=True)
class BaselineComparison:
    """A comparison as a page tells it.

    Attributes:
        report: what `contactlab compare` says.
        checks: what of it is not as before.
        maps: name and specification of maps of the paired runs: baseline, candidate, difference.
        command: what prints the same.
    """

    report: ComparisonReport
    checks: tuple[Check, ...]
    maps: dict[str, Spec]
    command: str


def compare_with_baseline(gathered: ReportData, baseline: Store) -> BaselineComparison:
    """Compare a store with a baseline.

    Raises:
        StoreError: a store is not sound, or no run of one is in the other.
    """
    store = gathered.store
    policy = _policy(baseline, store)
    report = compare(baseline.address, store.address, policy)
    pairing = pair_stores(baseline.address, store.address, policy)
    return BaselineComparison(
        report=report,
        checks=tuple(
            each for outcome in _TOLD for each in report.checks if each.outcome == outcome
        ),
        maps=dict(_maps(gathered, baseline, pairing)) if gathered.plane else {},
        command=f"contactlab compare {baseline.address} {store.address}"
        + ("" if policy.match == "id" else " --match axes"),
    )


def _policy(baseline: Store, candidate: Store) -> ComparePolicy:
    """Return a policy that pairs runs by id, or by axes where no id is shared."""
    ids, other = (each.columns.byte_strings("run_id") for each in (baseline, candidate))
    match = "id" if np.isin(ids, other).any() else "axes"
    return DEFAULT_POLICY.model_copy(update={"match": match})


def _maps(gathered: ReportData, baseline: Store, pairing: Pairing) -> list[tuple[str, Spec]]:
    assert gathered.plane is not None
    before, after = pairing.baseline, pairing.candidate
    plane = _at(gathered.plane, after)
    names = (*baseline.manifest.labels, *gathered.store.manifest.labels)
    maps = [
        (
            "labels",
            _label_maps(
                plane, _labels(baseline, names, before), _labels(gathered.store, names, after)
            ),
        )
    ]
    quantities = {each.name: each for each in read_quantities(baseline)}
    for each in _compared_quantities(gathered):
        if each.name in quantities:
            old = _values(quantities[each.name], before)
            maps.append((each.name, _number_maps(plane, old, _values(each, after))))
    return maps


def _compared_quantities(gathered: ReportData) -> list[Quantity]:
    """Return the quantities that get maps: the error, or else the depth."""
    name = gathered.weighing.report.error.name if gathered.weighing else _DEPTH
    return [each for each in gathered.quantities if each.name == name]


def _at(plane: MapAxes, rows: Rows) -> MapAxes:
    x, y = plane.x, plane.y
    return MapAxes(replace(x, codes=x.codes[rows]), y and replace(y, codes=y.codes[rows]))


def _labels(store: Store, names: Sequence[str], rows: Rows) -> RunLabels:
    found = read_run_labels(store, names)
    return replace(found, codes=found.codes[rows], masks=found.masks[rows])


def _values(quantity: Quantity, rows: Rows) -> Quantity:
    return replace(quantity, values=quantity.values[rows])


def _label_maps(plane: MapAxes, before: RunLabels, after: RunLabels) -> Spec:
    frame = MapFrame.of(plane, _THIRD)
    sides = [
        label_map(frame, *label_rows(label_counts(plane, each), each), each)
        for each in (before, after)
    ]
    moved = np.select(
        [after.codes < before.codes, after.codes > before.codes], [_WORSE, _BETTER], _SAME
    )
    change = RunLabels(
        names=("worse", "better", "stable"),
        letters=("W", "B", ""),
        colours=(COLOURS[1], COLOURS[0], STABLE_COLOUR),
        meanings=("", "", ""),
        counts=tuple(np.bincount(moved, minlength=3).tolist()),
        codes=moved,
        masks=np.zeros_like(moved),
        every=(),
    )
    pieces, letters = label_rows(label_counts(plane, change), change)
    return _abreast([*sides, label_map(frame, pieces, letters, change)])


def _number_maps(plane: MapAxes, before: Quantity, after: Quantity) -> Spec:
    frame = MapFrame.of(plane, _THIRD)
    values = [cell_statistic(plane, each, "worst") for each in (before, after)]
    title, least = f"worst {after.title}", after.told.resolution
    sides = [number_map(frame, *number_rows(each), title, least) for each in values]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.where(values[0] == values[1], 1.0, values[1] / values[0])
    ratios = np.where(np.isfinite(ratios) & (ratios > 0), ratios, np.nan)
    return _abreast([*sides, ratio_map(frame, *number_rows(ratios), after.title)])


def _abreast(charts: Sequence[Any]) -> Spec:
    titles = ("baseline", "candidate", "difference")
    named = [chart.properties(title=title) for chart, title in zip(charts, titles, strict=True)]
    joined = alt.hconcat(*named, spacing=24).resolve_scale(color="independent")
    spec = joined.to_dict()
    for place, part in enumerate(spec["hconcat"]):
        for layer in part["layer"]:
            layer["data"]["name"] += str(place)
    made = themed(spec)
    made["config"]["legend"] |= {"orient": "bottom", "columns": 2}
    return made
