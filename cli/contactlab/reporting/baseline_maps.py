"""A store beside its baseline: the comparison's verdicts, and maps of where the two differ."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import altair as alt
import numpy as np
from numpy.typing import NDArray

from contactlab.comparison.compare_stores import DEFAULT_POLICY, compare, pair_runs
from contactlab.comparison.pairing import Pairing
from contactlab.palette import COLOURS, STABLE_COLOUR
from contactlab.reporting.heatmap import Layered, label_map, number_map, ratio_map
from contactlab.reporting.map_cells import MapAxes, cell_statistic
from contactlab.reporting.report import ReportData
from contactlab.reporting.report_columns import (
    STABLE,
    Quantity,
    RunLabels,
    read_quantities,
    read_run_labels,
    summary_metrics,
)
from contactlab.reporting.vega_rendering import Spec, themed
from contactlab.schema.comparison_report import Check, ComparisonReport
from contactlab.schema.judged_check import CheckOutcome
from contactlab.store.finished_store import Store

_THIRD = 300, 260
_LISTED: tuple[CheckOutcome, ...] = ("failed", "warned", "noted")
_PANELS = ("baseline", "candidate", "difference")
Indices = NDArray[np.intp]


class BaselineComparison(NamedTuple):
    """A comparison as a page shows it: its checks, the failed ones first, and maps by name."""

    report: ComparisonReport
    checks: tuple[Check, ...]
    maps: dict[str, Spec]
    command: str


def compare_with_baseline(data: ReportData, baseline: Store) -> BaselineComparison:
    """Compare a store with a baseline; a StoreError says that one is damaged, or no run shared."""
    store = data.store
    ids, other = (each.columns.byte_strings("run_id") for each in (baseline, store))
    # Runs are paired by axes where no id is shared.
    match = "id" if np.isin(ids, other).any() else "axes"
    policy = DEFAULT_POLICY.model_copy(update={"match": match})
    report = compare(baseline.address, store.address, policy)
    pairing = pair_runs(baseline, store, policy)
    option = "" if policy.match == "id" else " --match axes"
    return BaselineComparison(
        report=report,
        checks=tuple(
            each for outcome in _LISTED for each in report.checks if each.outcome == outcome
        ),
        maps=dict(_maps(data, baseline, pairing)),
        command=f"contactlab compare {baseline.address} {store.address}{option}",
    )


def _maps(data: ReportData, baseline: Store, pairing: Pairing) -> Iterator[tuple[str, Spec]]:
    """Yield maps of the labels, and of the error or else the summary's first metric."""
    if data.map_axes is None:
        return
    before, after = pairing.baseline, pairing.candidate
    x, y = data.map_axes.x, data.map_axes.y
    axes = MapAxes(replace(x, codes=x.codes[after]), y and replace(y, codes=y.codes[after]))
    names = (*baseline.manifest.labels, *data.store.manifest.labels)
    old, new = _labels_of(baseline, names, before), _labels_of(data.store, names, after)
    yield "labels", _label_maps(axes, old, new)
    quantities = {each.name: each for each in read_quantities(baseline)}
    name = data.tradeoff.error.name if data.tradeoff else summary_metrics()[0]
    for each in data.quantities_named(name):
        if each.name in quantities:
            earlier = quantities[each.name]
            earlier = replace(earlier, values=earlier.values[before])
            yield each.name, _number_maps(axes, earlier, replace(each, values=each.values[after]))


def _labels_of(store: Store, names: Sequence[str], rows: Indices) -> RunLabels:
    labels = read_run_labels(store, names)
    return replace(labels, codes=labels.codes[rows], masks=labels.masks[rows])


def _label_maps(axes: MapAxes, before: RunLabels, after: RunLabels) -> Spec:
    # In the order of the names: labels are ordered worst first.
    moved = np.select([after.codes < before.codes, after.codes > before.codes], [0, 1], 2)
    change = replace(
        after,
        names=("worse", "better", STABLE),
        letters=("W", "B", ""),
        colours=(COLOURS[1], COLOURS[0], STABLE_COLOUR),
        codes=moved,
    )
    return _side_by_side([label_map(axes, each, _THIRD) for each in (before, after, change)])


def _number_maps(axes: MapAxes, before: Quantity, after: Quantity) -> Spec:
    values = [cell_statistic(axes, each, "worst") for each in (before, after)]
    title, resolution = f"worst {after.title}", after.column.resolution
    panels = [number_map(axes, each, title, resolution, _THIRD) for each in values]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.where(values[0] == values[1], 1.0, values[1] / values[0])
    ratios = np.where(np.isfinite(ratios) & (ratios > 0), ratios, np.nan)
    return _side_by_side([*panels, ratio_map(axes, ratios, after.title, _THIRD)])


def _side_by_side(charts: Sequence[Layered]) -> Spec:
    titled = [chart.properties(title=title) for chart, title in zip(charts, _PANELS, strict=True)]
    joined = alt.hconcat(*titled, spacing=24).resolve_scale(color="independent")
    spec = joined.to_dict()
    for place, part in enumerate(spec["hconcat"]):
        for layer in part["layer"]:
            layer["data"]["name"] += str(place)
    spec = themed(spec)
    spec["config"]["legend"] |= {"orient": "bottom", "columns": 2}
    return spec
