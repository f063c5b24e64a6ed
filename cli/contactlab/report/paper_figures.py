"""Figures for papers: the charts of a page, and some that it has no room for."""

from collections.abc import Callable, Iterator

from contactlab.report.heatmap import MapFrame, default_map, number_map, number_rows
from contactlab.report.impact_figures import (
    bounce_panels,
    bouncing_runs,
    cone_panel,
    first_impacts,
)
from contactlab.report.knob_changes import change_panels, knob_changes
from contactlab.report.map_cells import cell_statistic
from contactlab.report.page_charts import tradeoff_chart
from contactlab.report.report_data import ReportData
from contactlab.report.vega_rendering import Spec, themed


def figure_specs(data: ReportData) -> Iterator[tuple[str, Spec]]:
    """Yield name and specification of each figure for which the store has the data."""
    figures: dict[str, Callable[[ReportData], Spec | None]] = {
        "labels": default_map,
        "error": _error_map,
        "work-precision": tradeoff_chart,
        "bounces": _bounces,
        "cone": _cone,
        "effects": _effects,
    }
    for name, figure in figures.items():
        spec = figure(data)
        if spec is not None:
            yield name, spec


def _error_map(data: ReportData) -> Spec | None:
    """Return the map of the error that stands for accuracy."""
    if data.map_axes is None or data.tradeoff is None:
        return None
    for error in data.quantities_named(data.tradeoff.error.name):
        pieces, texts = number_rows(cell_statistic(data.map_axes, error, "worst"))
        title, resolution = f"worst {error.title}", error.column.resolution
        frame = MapFrame.of(data.map_axes)
        return themed(number_map(frame, pieces, texts, title, resolution).to_dict())
    return None


def _bounces(data: ReportData) -> Spec | None:
    runs = bouncing_runs(data.store, data.axes, ~data.labels.failed)
    return themed(bounce_panels(runs)) if runs else None


def _cone(data: ReportData) -> Spec | None:
    impacts = first_impacts(data.store)
    return themed(cone_panel(impacts)) if impacts else None


def _effects(data: ReportData) -> Spec | None:
    report = data.tradeoff
    names = [report.time.name, report.error.name] if report else ["cost_cpu_per_sim_s"]
    changes = knob_changes(data.axes, data.labels, data.quantities_named(*names))
    changes = [each for each in changes if any(each.ratios.values())]
    return themed(change_panels(changes, names)) if changes else None
