"""The page: everything of a store in one file that needs nothing else."""

from importlib import resources
from typing import TYPE_CHECKING, Any

from contactlab.report.baseline_maps import BaselineComparison, compare_with_baseline
from contactlab.report.knob_changes import knob_changes
from contactlab.report.packing import as_json, packed_text
from contactlab.report.page_charts import default_map, label_bar, static_svg, tradeoff_chart
from contactlab.report.page_content import PageContent, page_content
from contactlab.report.page_tables import (
    change_table,
    expectation_summary,
    expectations,
    front_table,
    header_lines,
    label_table,
    map_table,
    recommendation_text,
    unexpected_runs,
)
from contactlab.report.report_data import PageRequest, ReportData, read_report_data
from contactlab.report.vega_rendering import vega_bundle
from contactlab.store import Store

if TYPE_CHECKING:
    from jinja2 import Environment

_SCRIPTS = ("data", "state", "table", "heatmap", "weighing", "run", "main")


def page(store: Store, ask: PageRequest) -> tuple[str, tuple[str, ...]]:
    """Return the page of a store, and notes on what it leaves out."""
    gathered = read_report_data(store, ask.question)
    chart = tradeoff_chart(gathered)
    given = page_content(gathered, ask, chart)
    beside = compare_with_baseline(gathered, ask.baseline) if ask.baseline else None
    text = _page(gathered, given, chart, beside)
    return text, given.notes


def _page(
    gathered: ReportData,
    given: PageContent,
    chart: dict[str, Any] | None,
    beside: BaselineComparison | None,
) -> str:
    return (
        _environment()
        .get_template("page.html")
        .render(
            **_texts(gathered),
            **_pictures(gathered, chart),
            style=_read("style.css"),
            script="\n".join(_read(f"script/{name}.js") for name in _SCRIPTS),
            bundle=packed_text(vega_bundle()),
            words=packed_text(as_json(given.words)),
            columns=as_json(given.columns),
            series=as_json(given.series),
            left_out=given.notes,
            versus=beside,
            versus_maps=_versus_maps(beside),
        )
    )


def _texts(gathered: ReportData) -> dict[str, Any]:
    store = gathered.store
    manifest = store.manifest
    outcome, told = expectation_summary(manifest)
    return {
        "title": f"{manifest.sweep.name}: {manifest.sweep.scene}",
        "description": manifest.sweep.resolved.get("description") or "",
        "store": str(store.address),
        "runs": manifest.runs,
        "facts": header_lines(store),
        "outcome": outcome,
        "verdict": told,
        "labels": label_table(gathered.outcomes),
        "recommended": recommendation_text(gathered),
        "unweighed": gathered.unweighed,
        "front": front_table(gathered),
        "map": map_table(gathered),
        "boundary": gathered.boundary.told if gathered.boundary else "",
        "changes": change_table(
            gathered, knob_changes(gathered.axes, gathered.outcomes, gathered.quantities)
        ),
        "expectations": expectations(store),
        "missed": unexpected_runs(store),
    }


def _pictures(gathered: ReportData, chart: dict[str, Any] | None) -> dict[str, str]:
    plane = gathered.plane
    over = " and ".join(axis.name for axis in (plane.x, plane.y) if axis) if plane else ""
    return {
        "bar": static_svg(label_bar(gathered.outcomes), "All runs, split by label"),
        "heatmap": static_svg(default_map(gathered), f"Labels over {over}"),
        "chart": static_svg(chart, "Error against time of each configuration"),
    }


def _versus_maps(beside: BaselineComparison | None) -> list[str]:
    maps = beside.maps.items() if beside else ()
    return [static_svg(spec, f"{name}: baseline, candidate and difference") for name, spec in maps]


def _environment() -> "Environment":
    from jinja2 import Environment, PackageLoader, StrictUndefined  # noqa: PLC0415 - an extra

    return Environment(
        loader=PackageLoader("contactlab.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _read(name: str) -> str:
    return resources.files("contactlab.report").joinpath(name).read_text(encoding="utf-8")
