"""Figures for papers: the charts of a page, and some that need more room than it has."""

from collections.abc import Callable, Iterator
from typing import Any

from contactlab.report.bounces import bouncing
from contactlab.report.cells import statistic
from contactlab.report.changes import changes
from contactlab.report.charts import default_map
from contactlab.report.gathering import Gathered
from contactlab.report.heatmap import Frame, number_map, number_rows
from contactlab.report.impacts import approaches
from contactlab.report.panels import bounce_panels, change_panels, cone_panel
from contactlab.report.scatter import tradeoff_chart
from contactlab.report.theme import configured

Spec = dict[str, Any]


def figures(gathered: Gathered) -> Iterator[tuple[str, Spec]]:
    """Yield name and specification of each figure that can be drawn."""
    drawn: dict[str, Callable[[Gathered], Spec | None]] = {
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


def _error_map(gathered: Gathered) -> Spec | None:
    """Return the map of the error that the trade-off weighs."""
    if gathered.plane is None or gathered.weighing is None:
        return None
    name = gathered.weighing.report.error.name
    quantity = next((each for each in gathered.quantities if each.name == name), None)
    if quantity is None:
        return None
    pieces, words = number_rows(statistic(gathered.plane, quantity, "worst"))
    title, least = f"worst {quantity.title}", quantity.told.resolution
    return configured(number_map(Frame.of(gathered.plane), pieces, words, title, least).to_dict())


def _bounces(gathered: Gathered) -> Spec | None:
    found = bouncing(gathered.store, gathered.axes, ~gathered.outcomes.failed)
    return configured(bounce_panels(found)) if found else None


def _cone(gathered: Gathered) -> Spec | None:
    found = approaches(gathered.store)
    return configured(cone_panel(found)) if found else None


def _effects(gathered: Gathered) -> Spec | None:
    report = gathered.weighing.report if gathered.weighing else None
    names = [report.time.name, report.error.name] if report else ["cost_cpu_per_sim_s"]
    quantities = [each for each in gathered.quantities if each.name in names]
    found = changes(gathered.axes, gathered.outcomes, quantities)
    found = [each for each in found if any(each.ratios.values())]
    return configured(change_panels(found, names)) if found else None
