"""The page: a store in one HTML file that needs nothing else, with its tables."""

from collections.abc import Sequence
from importlib import resources
from itertools import islice

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from contactlab.charts import static_svg, vega_bundle
from contactlab.judge.wording import format_percent
from contactlab.page.engine_parts import engine_parts, engines_sentence
from contactlab.page.header_films import header_films
from contactlab.page.heatmap import compare_with_baseline, default_map, metric_map
from contactlab.page.map_cells import label_counts
from contactlab.page.packing import packed_text
from contactlab.page.page_charts import KnobChange, knob_changes, tradeoff_chart
from contactlab.page.page_content import listed_metrics, page_colours, page_content
from contactlab.page.paper_figures import physical_figures
from contactlab.page.sentences import closest_settings, reality_sentence, tradeoff_sentence
from contactlab.pareto.criteria import RECORDED
from contactlab.pareto.recommendation import (
    blocker_texts,
    next_step_text,
    robust_text,
    setting_text,
)
from contactlab.printable import visible
from contactlab.reporting.finding import finding
from contactlab.reporting.report import PageRequest, ReportData, read_report_data
from contactlab.reporting.report_columns import number_with_unit, summary_metrics, with_unit
from contactlab.schema.evidence import StoreManifest
from contactlab.schema.pair_expectation import Bounds, PairExpectation
from contactlab.schema.sweep_schema import Sweep
from contactlab.store.finished_store import Store
from contactlab.store.verify_store import trace_warning
from contactlab.studies.parity.report import HEADER, about, row, shown

_PACKAGE = __name__.rpartition(".")[0]
_MOST_UNEXPECTED = 50
_MOST_CELLS = 400
_MOST_RATIOS = 5
_SCRIPTS = (
    *("data", "state", "elements", "heatmap", "evaluation", "plots", "timeline", "run"),
    *("runs_table", "parallel", "tabs", "main"),
)
_MOST_LISTED = 24


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
        finalize=lambda value: visible(value) if type(value) is str else value,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    report = data.tradeoff
    wanted = report.recommendation.configuration if report and report.recommendation else None
    outcomes = report.configurations if report else ()
    changes = knob_changes(data.axes, data.labels, data.quantities)
    first, has_reality = first_look(data), bool(data.quantities_named("reality"))
    engines = engine_parts(data, request.parity)
    parity = engines.parity if engines else None
    text = environment.get_template("page.html").render(
        number=lambda value: "-" if value is None else f"{value:.3g}",
        with_unit=number_with_unit,
        heading=with_unit,
        setting=setting_text,
        data=data,
        sentences=[robust_text(report), next_step_text(report)] if report else [],
        blockers=blocker_texts(report) if report else [],
        titles={axis.name: axis.title for axis in data.axes},
        worst=next((outcome.worst for outcome in outcomes if outcome.configuration == wanted), {}),
        cheapest=sorted(
            outcomes,
            key=lambda configuration: (not configuration.feasible, configuration.time or 0.0),
        ),
        map=map_rows(data),
        changes=changes,
        ratios=ratio_names(data, changes),
        expectations=expectations(data.store.manifest),
        unexpected=unexpected_runs(data.store),
        finding=finding(data.axes, data.labels),
        first=first,
        films=header_films(data, first[0] if first else None) if request.traces else [],
        tradeoff_sentence=tradeoff_sentence(report) if report else "",
        reality=reality_sentence(data) if has_reality else "",
        closest=closest_settings(data) if has_reality else ([], [], []),
        reality_map=static_svg(metric_map(data, "reality"), "Distance to the recording")
        if has_reality
        else "",
        engines=engines,
        engines_sentence=engines_sentence(engines) if engines else "",
        percent=format_percent,
        parity_about=list(about(parity)) if parity else [],
        parity_header=HEADER,
        parity_rows=[(run.run_id, row(run)) for run in shown(parity)] if parity else [],
        listed=listed_runs(data),
        short=lambda settings, names: ", ".join(
            f"{name} {setting_text(settings[name])}" for name in names
        ),
        colours=page_colours(data.labels),
        physics={
            name: static_svg(spec, name) for name, spec in physical_figures(data).items() if spec
        },
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
    for expectation in sweep.expect:
        conditions = [f"{name} = {value}" for name, value in expectation.where.settings.items()]
        conditions += [expectation.where.where] if expectation.where.where else []
        expected = [" or ".join(expectation.label)] if expectation.label else []
        expected += [_bounds(name, bounds) for name, bounds in expectation.metrics.items()]
        expected += [_bounds(f"mean {name}", bounds) for name, bounds in expectation.mean.items()]
        said = expectation.model_dump(include=set(PairExpectation.model_fields), exclude_none=True)
        expected += [f"{name} {value}".replace("'", "") for name, value in said.items()]
        rows.append(
            (", ".join(conditions) or "all runs", "; ".join(expected), expectation.reason or "")
        )
    return rows


def _bounds(name: str, bounds: Bounds) -> str:
    low, high = bounds.min, bounds.max
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


def first_look(data: ReportData) -> tuple[str, str] | None:
    """Return id and label of the run to look at first: not as expected, or else the worst."""
    labels = data.labels
    met, given = data.store.columns.numbers("expectation_met")
    candidates = np.flatnonzero(given & (np.nan_to_num(met) == 0))
    candidates = candidates if len(candidates) else np.flatnonzero(labels.failed)
    if not len(candidates):
        return None
    row = int(candidates[labels.codes[candidates].argmin()])
    return str(data.store.columns.run_ids[row]), labels.names[labels.codes[row]]


def listed_runs(data: ReportData) -> tuple[list[str], list[list[str]]]:
    """Return header and rows of a table of some runs, the worst first."""
    quantities = data.quantities_named(*listed_metrics(data))
    header = ["run", "label", *(column.title for column in (*data.axes, *quantities))]
    ids = data.store.columns.run_ids
    rows = [
        [
            str(ids[row]),
            data.labels.names[data.labels.codes[row]],
            *(axis.ticks[axis.codes[row]] for axis in data.axes),
            *(f"{quantity.values[row]:.4g}" for quantity in quantities),
        ]
        for row in np.argsort(data.labels.codes, kind="stable")[:_MOST_LISTED].tolist()
    ]
    return header, rows


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
    known = {
        name for change in changes for name, ratio in change.ratios.items() if ratio is not None
    }
    wanted = dict.fromkeys((*first, *summary_metrics()))
    return [name for name in wanted if name in known][:_MOST_RATIOS]
