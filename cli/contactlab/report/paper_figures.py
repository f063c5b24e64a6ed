"""Figures for papers: the charts of a page, and some that need more room than it has."""

from collections.abc import Callable, Iterator
from typing import Any

from contactlab.report.heatmap import MapFrame, number_map, number_rows
from contactlab.report.impact_figures import (
    bounce_panels,
    bouncing_runs,
    change_panels,
    cone_panel,
    first_impacts,
)
from contactlab.report.knob_changes import knob_changes
from contactlab.report.map_cells import cell_statistic
from contactlab.report.page_charts import default_map, tradeoff_chart
from contactlab.report.report_data import ReportData
from contactlab.report.vega_rendering import themed

Spec = dict[str, Any]


def figure_specs(gathered: ReportData) -> Iterator[tuple[str, Spec]]:
    """Yield name and specification of each figure that can be drawn."""
    drawn: dict[str, Callable[[ReportData], Spec | None]] = {
        "labels": default_map,
        "error": _error_map,
        "work-precision": tradeoff_chart,
        "bounces": _bounces,
        "cone": _cone,
        "effects": _effects,
    }
    for name, draw in drawn.items():
        spec = draw(gathered)
        if spec is not None:
            yield name, spec


def _error_map(gathered: ReportData) -> Spec | None:
    """Return the map of the error that the trade-off weighs."""
    if gathered.plane is None or gathered.weighing is None:
        return None
    name = gathered.weighing.report.error.name
    quantity = next((each for each in gathered.quantities if each.name == name), None)
    if quantity is None:
        return None
    pieces, words = number_rows(cell_statistic(gathered.plane, quantity, "worst"))
    title, least = f"worst {quantity.title}", quantity.told.resolution
    return themed(number_map(MapFrame.of(gathered.plane), pieces, words, title, least).to_dict())


def _bounces(gathered: ReportData) -> Spec | None:
    found = bouncing_runs(gathered.store, gathered.axes, ~gathered.outcomes.failed)
    return themed(bounce_panels(found)) if found else None


def _cone(gathered: ReportData) -> Spec | None:
    found = first_impacts(gathered.store)
    return themed(cone_panel(found)) if found else None


def _effects(gathered: ReportData) -> Spec | None:
    report = gathered.weighing.report if gathered.weighing else None
    names = [report.time.name, report.error.name] if report else ["cost_cpu_per_sim_s"]
    quantities = [each for each in gathered.quantities if each.name in names]
    found = knob_changes(gathered.axes, gathered.outcomes, quantities)
    found = [each for each in found if any(each.ratios.values())]
    return themed(change_panels(found, names)) if found else None
