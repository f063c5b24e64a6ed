"""The page: a store in one HTML file that needs nothing else, with its tables."""

from collections.abc import Sequence
from importlib import resources
from itertools import islice

from jinja2 import Environment, PackageLoader, StrictUndefined

from contactlab.charts import static_svg, vega_bundle
from contactlab.pareto.criteria import RECORDED
from contactlab.pareto.recommendation import (
    blocker_texts,
    next_step_text,
    robust_text,
    setting_text,
)
from contactlab.printable import visible
from contactlab.reporting.map_cells import label_counts
from contactlab.reporting.packing import packed_text
from contactlab.reporting.report import PageRequest, ReportData, read_report_data
from contactlab.reporting.report_columns import number_with_unit, summary_metrics, with_unit
from contactlab.schema.evidence import StoreManifest
from contactlab.schema.pair_expectation import PairExpectation
from contactlab.schema.sweep_schema import Sweep
from contactlab.store.finished_store import Store
from contactlab.store.verify_store import trace_warning
from contactlab_page.heatmap import compare_with_baseline, default_map
from contactlab_page.page_charts import KnobChange, knob_changes, label_bar, tradeoff_chart
from contactlab_page.page_content import page_content

_PACKAGE = __name__.rpartition(".")[0]
_MOST_UNEXPECTED = 50
_MOST_CELLS = 400
_MOST_RATIOS = 5
_SCRIPTS = ("data", "state", "elements", "heatmap", "evaluation", "run", "main")


def html_page(store: Store, request: PageRequest) -> tuple[str, tuple[str, ...]]:
    """Return the page of a store, and notes on what it leaves out."""
    data = read_report_data(store, request.criteria)
    chart = tradeoff_chart(data)
    content, notes = page_content(data, request, chart)
    comparison = compare_with_baseline(data, request.baseline) if request.baseline else None
    maps = comparison.maps.items() if comparison else ()
    axes = " and ".join(data.map_axes.names) if data.map_axes else ""
    notes = (*notes, *trace_warning(store))
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
    wanted = report.recommendation.configuration if report and report.recommendation else None
    outcomes = report.configurations if report else ()
    changes = knob_changes(data.axes, data.labels, data.quantities)
    text = environment.get_template("page.html").render(
        number=lambda value: "-" if value is None else f"{value:.3g}",
        with_unit=number_with_unit,
        heading=with_unit,
        setting=setting_text,
        data=data,
        sentences=[robust_text(report), next_step_text(report)] if report else [],
        blockers=blocker_texts(report) if report else [],
        titles={axis.name: axis.title for axis in data.axes},
        worst=next((each.worst for each in outcomes if each.configuration == wanted), {}),
        cheapest=sorted(outcomes, key=lambda each: (not each.feasible, each.time or 0.0)),
        map=map_rows(data),
        changes=changes,
        ratios=ratio_names(data, changes),
        expectations=expectations(data.store.manifest),
        unexpected=unexpected_runs(data.store),
        bar=static_svg(label_bar(data.labels), "All runs by label"),
        heatmap=static_svg(default_map(data), f"Labels over {axes}"),
        chart=static_svg(chart, "Error against time of each configuration"),
        script="\n".join(_read(f"script/{name}.js") for name in _SCRIPTS),
        bundle=packed_text(vega_bundle()),
        **content,
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


def expectations(manifest: StoreManifest) -> list[tuple[str, str, str]]:
    """Return which runs have an expectation, the expectation, and its reason."""
    sweep = Sweep.model_validate(manifest.sweep.resolved)
    rows: list[tuple[str, str, str]] = []
    for each in sweep.expect:
        conditions = [f"{name} = {value}" for name, value in each.where.settings.items()]
        conditions += [each.where.where] if each.where.where else []
        expected = [" or ".join(each.label)] if each.label else []
        expected += [_bounds(name, bounds.min, bounds.max) for name, bounds in each.metrics.items()]
        said = each.model_dump(include=set(PairExpectation.model_fields), exclude_none=True)
        expected += [f"{name} {value}".replace("'", "") for name, value in said.items()]
        rows.append((", ".join(conditions) or "all runs", "; ".join(expected), each.reason or ""))
    return rows


def _bounds(name: str, low: float | None, high: float | None) -> str:
    if low is not None and high is not None:
        return f"{low:g} ≤ {name} ≤ {high:g}"
    return f"{name} ≥ {low:g}" if low is not None else f"{name} ≤ {high:g}"


def unexpected_runs(store: Store) -> list[tuple[str, str, str]]:
    """Return id, label and unmet expectation of the first runs that are not as expected."""
    if not store.manifest.expectations.get("unmet", 0):
        return []
    columns = store.columns.to_pydict(["run_id", "label", "expectation_met", "expectation_reason"])
    rows = zip(*columns.values(), strict=True)
    unmet = ((run, label, reason or "") for run, label, met, reason in rows if met is False)
    return list(islice(unmet, _MOST_UNEXPECTED))


def map_rows(data: ReportData) -> list[tuple[str, list[str]]]:
    """Return the rows of the default map from the top, as label counts; none of too many cells."""
    axes, labels = data.map_axes, data.labels
    if axes is None or axes.size > _MOST_CELLS:
        return []
    ticks = axes.y.ticks if axes.y else ("all",)
    rows = [
        [", ".join(f"{n} {labels.names[code]}" for code, n in enumerate(cell) if n) for cell in row]
        for row in label_counts(axes, labels).tolist()
    ]
    return list(zip(ticks, rows, strict=True))[::-1]


def ratio_names(data: ReportData, changes: Sequence[KnobChange]) -> list[str]:
    """Return five quantities that changes have ratios of: time, error, and what is summarized."""
    report = data.tradeoff
    first = (report.time.name, report.error.name, *report.tolerances) if report else (RECORDED,)
    known = {name for each in changes for name, ratio in each.ratios.items() if ratio is not None}
    wanted = dict.fromkeys((*first, *summary_metrics()))
    return [name for name in wanted if name in known][:_MOST_RATIOS]
