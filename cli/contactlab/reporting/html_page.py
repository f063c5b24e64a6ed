"""The page: a store in one HTML file that needs nothing else."""

from importlib import resources

from jinja2 import Environment, PackageLoader, StrictUndefined

from contactlab.pareto.recommendation import (
    blocker_texts,
    next_step_text,
    robust_text,
    setting_text,
    settings_text,
)
from contactlab.printable import visible
from contactlab.reporting.baseline_maps import compare_with_baseline
from contactlab.reporting.heatmap import default_map
from contactlab.reporting.knob_changes import knob_changes
from contactlab.reporting.packing import as_json, packed_text
from contactlab.reporting.page_charts import label_bar, tradeoff_chart
from contactlab.reporting.page_content import page_content
from contactlab.reporting.page_tables import (
    change_table,
    expectations,
    front_table,
    map_table,
    number_text,
    unexpected_runs,
)
from contactlab.reporting.report_columns import number_with_unit
from contactlab.reporting.report_data import PageRequest, read_report_data
from contactlab.reporting.vega_rendering import static_svg, vega_bundle
from contactlab.store.finished_store import Store
from contactlab.store.verify_store import trace_warning

_PACKAGE = __name__.rpartition(".")[0]
_SCRIPTS = ("data", "state", "elements", "heatmap", "evaluation", "run", "main")


def html_page(store: Store, request: PageRequest) -> tuple[str, tuple[str, ...]]:
    """Return the page of a store, and notes on what it leaves out."""
    data = read_report_data(store, request.criteria)
    chart = tradeoff_chart(data)
    content = page_content(data, request, chart)
    comparison = compare_with_baseline(data, request.baseline) if request.baseline else None
    maps = comparison.maps.items() if comparison else ()
    axes = " and ".join(data.map_axes.names) if data.map_axes else ""
    notes = (*content.notes, *trace_warning(store))
    environment = Environment(
        loader=PackageLoader(_PACKAGE),
        autoescape=True,
        # Markup is text of our own; all other text may be data.
        finalize=lambda each: visible(each) if type(each) is str else each,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    report = data.tradeoff
    chosen = [
        each
        for each in (report.configurations if report else ())
        if report
        and report.recommendation
        and each.configuration == report.recommendation.configuration
    ]
    text = environment.get_template("page.html").render(
        number=number_text,
        with_unit=number_with_unit,
        setting=setting_text,
        settings=settings_text,
        manifest=data.store.manifest,
        store=str(data.store.address),
        labels=data.labels,
        tradeoff=report,
        sentences=[robust_text(report), next_step_text(report)] if report else [],
        blockers=blocker_texts(report) if report else [],
        titles={axis.name: axis.title for axis in data.axes},
        worst=chosen[0].worst if chosen else {},
        no_tradeoff=data.no_tradeoff,
        front=front_table(data),
        map=map_table(data),
        boundary=data.boundary.meaning if data.boundary else "",
        changes=change_table(data, knob_changes(data.axes, data.labels, data.quantities)),
        expectations=expectations(data.store.manifest),
        unexpected=unexpected_runs(data.store),
        bar=static_svg(label_bar(data.labels), "All runs by label"),
        heatmap=static_svg(default_map(data), f"Labels over {axes}"),
        chart=static_svg(chart, "Error against time of each configuration"),
        script="\n".join(_read(f"script/{name}.js") for name in _SCRIPTS),
        bundle=packed_text(vega_bundle()),
        metadata=packed_text(as_json(content.metadata)),
        columns=as_json(content.columns),
        series=as_json(content.series),
        style=_read("style.css"),
        notes=notes,
        comparison=comparison,
        comparison_maps=[
            static_svg(spec, f"{name}: baseline, candidate and difference") for name, spec in maps
        ],
    )
    return text, notes


def _read(name: str) -> str:
    return resources.files(_PACKAGE).joinpath(name).read_text(encoding="utf-8")
