"""The page: a store in one HTML file that needs nothing else.

The view has all that the templates read, by topic. Each part is built by one function.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from altair.utils.schemapi import debug_mode

from contactlab.charts import Spec, colours_on_dark, static_svg, vega_bundle
from contactlab.judge.worst_runs import worst_first
from contactlab.page.engine_parts import EngineParts, engine_parts, engines_sentence
from contactlab.page.examination_view import ExaminationView, examination_view
from contactlab.page.header_films import Films, FocalPicture, focal_picture, header_films
from contactlab.page.heatmap import (
    BaselineComparison,
    compare_with_baseline,
    default_map,
    metric_map,
)
from contactlab.page.inferred_cells import inferred_labels
from contactlab.page.map_cells import label_counts
from contactlab.page.packing import packed_text
from contactlab.page.page_charts import KnobChange, knob_changes, tradeoff_chart
from contactlab.page.page_template import open_templates
from contactlab.page.paper_figures import physical_figures
from contactlab.page.script_data import ScriptData, listed_metrics, page_colours, script_data
from contactlab.page.sentences import closest_settings, reality_sentence, tradeoff_sentence
from contactlab.pareto.criteria import RECORDED_TIME_COLUMN
from contactlab.pareto.recommendation import (
    next_step_text,
    robust_text,
    setting_text,
    settings_text,
)
from contactlab.printable import visible_or_other
from contactlab.rendering.amounts import format_amount, format_interval, format_percent
from contactlab.reporting.boundaries import boundary_lines, describe_coverage
from contactlab.reporting.equal_runs import describe_equal_runs
from contactlab.reporting.finding import write_finding
from contactlab.reporting.label_shares import share_words
from contactlab.reporting.report import PageRequest, ReportData, read_report_data
from contactlab.reporting.report_columns import (
    Quantity,
    number_with_unit,
    read_accepted_overlap,
    summary_metrics,
    with_unit,
)
from contactlab.reporting.sensitivity import (
    axes_of_starts,
    budget_sentence,
    by_share,
    find_sensitivities,
)
from contactlab.resources import read_style
from contactlab.schema.evidence import ParameterRow, StoreManifest
from contactlab.schema.sweep_schema import Bounds
from contactlab.schema.tradeoff_report import Configuration, TradeoffReport
from contactlab.step_progress import step_names
from contactlab.store.finished_store import Store
from contactlab.store.verify_store import trace_warning
from contactlab.studies.parity.report_sections import HEADER, describe_report, run_cells, worst_runs

_SCRIPTS = (
    *("data", "state", "elements", "heatmap", "evaluation", "plots", "timeline", "run"),
    *("runs_table", "parallel", "tabs", "main"),
)


@dataclass(frozen=True)
class Table:
    """A table of texts; the first cell of a run's row is its id."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    foot: Sequence[str] = ()


class StableTile(NamedTuple):
    """A number of a sweep without failures, its meaning, and the id of a run."""

    text: str
    meaning: str
    run: str


@dataclass(frozen=True)
class HeadView:
    """The head: finding, sentences, picture, films, and the run to look at first, id and label.

    Notes are on data that the page aggregates, remarks on the store.
    """

    finding: str
    reality: str
    focal: FocalPicture | None
    films: Films
    first: tuple[str, str] | None
    stable_tiles: Sequence[StableTile]
    notes: tuple[str, ...]
    remarks: tuple[str, ...]


@dataclass(frozen=True)
class OutcomeView:
    """A label with its runs; start and width are of its piece of a bar of 1000 units."""

    name: str
    letter: str
    colour: str
    count: int
    share: str
    start: float
    width: float
    meaning: str
    advice: str


@dataclass(frozen=True)
class MapView:
    """The map of labels, and its cells as texts from the top; no rows of too many cells."""

    picture: str
    corner: str
    ticks: Sequence[str]
    rows: Sequence[tuple[str, Sequence[str]]]
    has_closed_form: bool
    coverage: str  # how far cells without runs are known; empty where all ran
    draws_inferred: bool  # whether such cells have the label that is inferred
    boundary: Sequence[str]  # where outcomes change, in lines


@dataclass(frozen=True)
class TradeoffView:
    """The trade-off of accuracy and time; without a report, the reason."""

    report: TradeoffReport | None
    missing: str = ""
    sentence: str = ""
    recommended: Sequence[str] = ()
    blockers: Sequence[str] = ()
    worst: Mapping[str, float | None] | None = None
    chart: str = ""
    cheapest: Sequence[Configuration] = ()


@dataclass(frozen=True)
class RealityView:
    """The distance of runs to recordings: sentence, meaning, map, and the closest settings."""

    sentence: str
    description: str
    picture: str
    closest: Table


@dataclass(frozen=True)
class EffectsView:
    """Effects of changing one knob, and the quantities with shown ratios."""

    changes: Sequence[KnobChange]
    ratios: Sequence[str]


@dataclass(frozen=True)
class ExpectationsView:
    """Expectations as runs, expected, reason; and those runs that are not as expected."""

    rows: Sequence[tuple[str, str, str]]
    unexpected: Sequence[tuple[str, str, str]]


@dataclass(frozen=True)
class EnginesView:
    """Engines side by side, and the runs of a report of parity as ids and rows."""

    parts: EngineParts
    sentence: str
    about: Sequence[str]
    header: Sequence[str]
    runs: Sequence[tuple[str, Sequence[str]]]


@dataclass(frozen=True)
class ComparisonView:
    """The comparison with a baseline, and its maps."""

    result: BaselineComparison
    pictures: Sequence[str]


@dataclass(frozen=True)
class SensitivityView:
    """Shares of a metric's variance, an axis a row: its name, shares and intervals."""

    title: str
    rows: Sequence[tuple[str, float, str, float, str]]


@dataclass(frozen=True)
class BudgetView:
    """Errors by sampled axes in one run: its title, a row for each axis, and axes without one."""

    title: str
    rows: Sequence[ParameterRow]
    others: Sequence[str]


@dataclass(frozen=True)
class ScriptView:
    """The script: its data, its code, and the charting library, packed."""

    data: ScriptData
    code: str
    bundle: str


@dataclass(frozen=True)
class PageView:
    """A page: a part is None if the store has no data for it."""

    store: str
    manifest: StoreManifest
    style: str
    head: HeadView
    outcomes: Sequence[OutcomeView]
    map: MapView | None
    tradeoff: TradeoffView | None
    reality: RealityView | None
    runs: Table
    figures: Mapping[str, str]
    effects: EffectsView | None
    sensitivities: Sequence[SensitivityView]
    budgets: Sequence[BudgetView]
    expectations: ExpectationsView | None
    engines: EnginesView | None
    comparison: ComparisonView | None
    script: ScriptView
    examination: ExaminationView | None = None

    @property
    def title(self) -> str:
        """Title: the model, and the number of runs of a sweep."""
        if self.examination is not None:
            return Path(self.examination.report.model).name
        sweep, runs = self.manifest.sweep, self.manifest.runs
        scene_file = sweep.resolved.get("scene")
        model = (
            "/".join(Path(scene_file).parts[-2:]) if isinstance(scene_file, str) else sweep.scene
        )
        return f"{model}: {runs:,} {'run' if runs == 1 else 'runs'}"

    @property
    def stable(self) -> int:
        """Number of stable runs."""
        return next((outcome.count for outcome in self.outcomes if outcome.name == "stable"), 0)


def page_view(store: Store, request: PageRequest) -> PageView:
    """Return the view of a store's page; for the errors see `read_report_data`."""
    with step_names(3) as begin_step:
        begin_step("reading the runs")
        data = read_report_data(store, request.criteria)
        chart = tradeoff_chart(data)
        begin_step("reading traces")
        script = script_data(data, request, chart)
        begin_step("drawing")
        reality = reality_view(data)
        return PageView(
            store=str(store.address),
            manifest=store.manifest,
            style=read_style("page") + colours_on_dark(data.labels.colours),
            head=head_view(data, request, reality, script.notes),
            outcomes=list(outcome_views(data)),
            # Seeds of one model make neither a map nor a trade-off.
            map=None if request.examination else map_view(data),
            tradeoff=None if request.examination else tradeoff_view(data, chart),
            reality=reality,
            runs=listed_runs(data),
            figures={
                name: static_svg(spec, name)
                for name, spec in physical_figures(data).items()
                if spec
            },
            effects=effects_view(data),
            sensitivities=[*sensitivity_views(data.store)],
            budgets=[*budget_views(data.store)],
            expectations=expectations_view(store),
            engines=engines_view(data, request),
            comparison=comparison_view(data, request),
            examination=examination_view(store, request.examination, request.grip),
            script=ScriptView(
                script,
                "\n".join(
                    Path(__file__)
                    .with_name("script")
                    .joinpath(f"{name}.js")
                    .read_text(encoding="utf-8")
                    for name in _SCRIPTS
                ),
                packed_text(vega_bundle()),
            ),
        )


def head_view(
    data: ReportData, request: PageRequest, reality: RealityView | None, notes: Sequence[str]
) -> HeadView:
    """Return the head of a page; its remarks are on equal runs and damaged traces."""
    first = first_look(data)
    pictured = first[0] if first else None
    shows_films = request.traces and request.examination is None
    focal = focal_picture(data, pictured) if shows_films else None
    equal_runs = [] if request.examination else describe_equal_runs(data.axes, data.store.columns)
    return HeadView(
        finding=request.examination.headline
        if request.examination
        else write_finding(data.axes, data.labels, share_words(data.store)),
        reality=reality.sentence if reality else "",
        films=header_films(data, pictured, has_moment=focal is not None)
        if shows_films
        else Films([]),
        focal=focal,
        first=first,
        stable_tiles=[] if request.examination else [*list_stable_tiles(data)],
        notes=(*notes,),
        remarks=(*equal_runs, *trace_warning(data.store)),
    )


def list_stable_tiles(data: ReportData) -> Iterator[StableTile]:
    """Yield the deepest contact and the speeds of a sweep, if all of its runs are stable."""
    if data.labels.failed.any():
        return
    for depth in data.quantities_named("penetration_max"):
        row = int(np.nanargmax(depth.values))
        # The axes that decide the depth most come first.
        spread = {
            axis.name: np.ptp(
                [np.nanmax(depth.values[axis.codes == code]) for code in np.unique(axis.codes)]
            )
            for axis in data.axes
        }
        decisive = sorted(data.axes, key=lambda axis: -spread[axis.name])
        settings = ", ".join(
            f"{axis.name} {axis.ticks[axis.codes[row]]} {axis.amount_unit}".strip()
            for axis in decisive[:3]
        )
        run = data.store.columns.run_id(row)
        text = f"deepest contact{f': {settings}' if settings else ''}"
        text = "; ".join(filter(None, (text, read_accepted_overlap(data.store.columns, row))))
        yield StableTile(format_amount(float(depth.values[row]), "mm"), text, run)
    for cost in data.quantities_named(RECORDED_TIME_COLUMN):
        row = int(np.nanargmax(cost.values))
        slowest, fastest = (1 / float(find(cost.values)) for find in (np.nanmax, np.nanmin))
        yield StableTile(
            f"{slowest:,.3g} to {fastest:,.3g} x real time",
            "slowest and fastest run",
            data.store.columns.run_id(row),
        )


def first_look(data: ReportData) -> tuple[str, str] | None:
    """Return id and label of the run to look at first: not as expected, otherwise the worst."""
    labels = data.labels
    values, is_finite = data.store.columns.numbers("expectation_met")
    candidates = np.flatnonzero(is_finite & (np.nan_to_num(values) == 0))
    candidates = candidates if len(candidates) else np.flatnonzero(labels.failed)
    if not len(candidates):
        return None
    code = int(labels.codes[candidates].min())
    worst = labels.worst_rows(data.store, code)
    row = int(worst[np.isin(worst, candidates)][0])
    return data.store.columns.run_id(row), labels.names[labels.codes[row]]


def outcome_views(data: ReportData) -> Iterator[OutcomeView]:
    """Yield the labels of a store, the worst first."""
    labels, runs = data.labels, max(1, data.store.manifest.runs)
    share = share_words(data.store)
    starts = accumulate(labels.counts, initial=0)
    columns = (labels.names, labels.letters, page_colours(labels), labels.counts, labels.facts)
    for start, name, letter, colour, count, facts in zip(starts, *columns, strict=False):
        place = 1000 * start / runs, 1000 * count / runs
        # A stable run needs no change.
        advice = "" if name == "stable" else facts.advice
        share_text = share(count, runs)
        yield OutcomeView(name, letter, colour, count, share_text, *place, facts.meaning, advice)


def map_view(data: ReportData) -> MapView | None:
    """Return the default map; None for a store without axes."""
    axes = data.map_axes
    if axes is None:
        return None
    most_cells = 400  # of a table next to the picture
    rows = list[tuple[str, list[str]]]()
    if axes.size <= most_cells:
        ticks, names = axes.y.ticks if axes.y else ("all",), data.labels.names
        for tick, line in zip(ticks, label_counts(axes, data.labels).tolist(), strict=True):
            cell_texts = [
                [f"{n} {names[code]}" for code, n in enumerate(cell) if n] for cell in line
            ]
            rows.insert(0, (tick, list(map(", ".join, cell_texts))))
    return MapView(
        picture=static_svg(default_map(data), f"Labels over {' and '.join(axes.names)}"),
        corner=f"{axes.y.title} \\ {axes.x.title}" if axes.y else axes.x.title,
        ticks=axes.x.ticks,
        rows=rows,
        has_closed_form=any(column.name == "oracle_expected" for column in data.quantities.columns),
        coverage=describe_coverage(data.boundaries) if data.boundaries else "",
        draws_inferred=any(True for _ in inferred_labels(data)),
        boundary=[*boundary_lines(data.boundaries)] if data.boundaries else [],
    )


def sensitivity_views(store: Store) -> Iterator[SensitivityView]:
    """Yield the share of a metric's variance for each sampled axis."""
    for sensitivity in find_sensitivities(store):
        shared = ", ".join(f"{name} {value}" for name, value in sensitivity.shared.items())
        spans = [
            [format_interval(low, high) for low, high in interval.tolist()]
            for interval in (sensitivity.first_interval, sensitivity.total_interval)
        ]
        rows = zip(
            sensitivity.axes,
            sensitivity.first.tolist(),
            spans[0],
            sensitivity.total.tolist(),
            spans[1],
            strict=True,
        )
        yield SensitivityView(
            f"{sensitivity.metric}{f' of {shared}' if shared else ''}",
            sorted(rows, key=lambda row: -row[3]),
        )


def budget_views(store: Store) -> Iterator[BudgetView]:
    """Yield the errors by sampled axes in the run in the middle of their ranges."""
    for budget in store.manifest.parameter_budgets:
        title, rows = budget_sentence(budget, store), by_share(budget)
        yield BudgetView(f"{title[:1].upper()}{title[1:]}", rows, axes_of_starts(budget))


def tradeoff_view(data: ReportData, chart: Spec | None) -> TradeoffView | None:
    """Return the trade-off, or the reason why it is missing; None without either."""
    report = data.tradeoff
    if report is None:
        return TradeoffView(None, data.no_tradeoff) if data.no_tradeoff else None
    recommended = report.recommendation.configuration if report.recommendation else None
    worst = (
        outcome.worst for outcome in report.configurations if outcome.configuration == recommended
    )
    return TradeoffView(
        report=report,
        sentence=tradeoff_sentence(report),
        recommended=[text for text in (robust_text(report), next_step_text(report)) if text],
        blockers=[blocker.sentence for blocker in report.blockers],
        worst=next(worst, {}),
        chart=static_svg(chart, "Error against time of each configuration") if chart else "",
        cheapest=sorted(
            report.configurations,
            key=lambda configuration: (not configuration.feasible, configuration.time or 0.0),
        ),
    )


def reality_view(data: ReportData) -> RealityView | None:
    """Return the distance to recordings; None if no run was compared with one."""
    for reality in data.quantities_named("reality"):
        header, rows, foot = closest_settings(data)
        return RealityView(
            sentence=reality_sentence(data),
            description=reality.column.description,
            picture=static_svg(metric_map(data, "reality"), "Distance to the recording"),
            closest=Table(header, rows, foot),
        )
    return None


def listed_runs(data: ReportData) -> Table:
    """Return a table of some runs, the worst first."""
    most_listed = 24
    worst = list[int]()
    for code in range(len(data.labels.names)):
        if len(worst) < most_listed:
            own = data.labels.worst_rows(data.store, code)
            worst += own[: most_listed - len(worst)].tolist()
    # One column at a time is in memory.
    quantities = [
        Quantity(quantity.column, quantity.values[worst])
        for quantity in data.quantities.select_named(listed_metrics(data))
    ]
    rows = [
        [
            str(identity["run_id"]),
            data.labels.names[data.labels.codes[row]],
            *(axis.ticks[axis.codes[row]] for axis in data.axes),
            *(f"{quantity.values[place]:.4g}" for quantity in quantities),
        ]
        for place, (row, identity) in enumerate(
            zip(worst, data.store.columns.select_values(["run_id"], worst), strict=True)
        )
    ]
    titles = (column.title for column in (*data.axes, *quantities))
    return Table(["run", "label", *titles], rows)


def effects_view(data: ReportData) -> EffectsView | None:
    """Return the effect of each knob; None if no two runs differ in one alone."""
    report = data.tradeoff
    first = (
        (report.time.name, report.error.name, *report.tolerances)
        if report
        else (RECORDED_TIME_COLUMN,)
    )
    metric_names = dict.fromkeys((*first, *summary_metrics()))
    quantities = (
        quantity for name in metric_names for quantity in data.quantities.select_named([name])
    )
    most_ratios = 5
    changes = knob_changes(data.axes, data.labels, quantities, most_ratios)
    return EffectsView(changes, list(changes[0].ratios)) if changes else None


def expectations_view(store: Store) -> ExpectationsView | None:
    """Return expectations and the worst runs that do not meet theirs; None without expectations."""
    rows = list[tuple[str, str, str]]()
    sweep = store.sweep
    for expectation in sweep.expect:
        conditions = [f"{name} = {value}" for name, value in expectation.where.settings.items()]
        conditions += [expectation.where.where] if expectation.where.where else []
        expected = [" or ".join(expectation.label)] if expectation.label else []
        expected += [_format_bounds(name, bounds) for name, bounds in expectation.metrics.items()]
        expected += [
            _format_bounds(f"mean {name}", bounds) for name, bounds in expectation.mean.items()
        ]
        expected += expectation.must
        rows.append(
            (", ".join(conditions) or "all runs", "; ".join(expected), expectation.reason or "")
        )
    if not rows:
        return None
    unexpected = list[tuple[str, str, str]]()
    if store.manifest.expectations.get("unmet", 0):
        most_listed = 50
        unmet_rows = np.flatnonzero(store.columns.numbers("expectation_met").values == 0)
        unmet = worst_first(store, unmet_rows)
        for row in store.columns.select_values(
            ["run_id", "label", "expectation_reason"], unmet[:most_listed].tolist()
        ):
            unexpected.append((row["run_id"], row["label"], row["expectation_reason"] or ""))
    return ExpectationsView(rows, unexpected)


def _format_bounds(name: str, bounds: Bounds) -> str:
    low, high = bounds.min, bounds.max
    if low is not None and high is not None:
        return f"{low:g} ≤ {name} ≤ {high:g}"
    return f"{name} ≥ {low:g}" if low is not None else f"{name} ≤ {high:g}"


def engines_view(data: ReportData, request: PageRequest) -> EnginesView | None:
    """Return engines side by side; None for one engine without a report of parity."""
    parts = engine_parts(data, request.parity)
    if parts is None:
        return None
    parity = parts.parity
    return EnginesView(
        parts=parts,
        sentence=engines_sentence(parts),
        about=list(describe_report(parity)) if parity else [],
        header=HEADER,
        runs=[(run.run_id, run_cells(run)) for run in worst_runs(parity)] if parity else [],
    )


def comparison_view(data: ReportData, request: PageRequest) -> ComparisonView | None:
    """Return the comparison with a baseline; None without one."""
    if request.baseline is None:
        return None
    result = compare_with_baseline(data, request.baseline)
    pictures = [
        static_svg(spec, f"{name}: baseline, candidate and difference")
        for name, spec in result.maps.items()
    ]
    return ComparisonView(result, pictures)


def html_page(store: Store, request: PageRequest) -> tuple[str, tuple[str, ...]]:
    """Return the page of a store, with notes on omitted data and remarks on the store."""
    # Markup is text of our own; all other text may be data.
    environment = open_templates(finalize=visible_or_other)
    environment.filters.update(_FILTERS)
    # Altair's checks of each part take longer than the page; tests/reporting makes them.
    with debug_mode(False), store.keeping_trace():
        view = page_view(store, request)
    notes = (*view.head.notes, *view.head.remarks)
    return environment.get_template("page.html").render(view=view), notes


def _format_number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


_FILTERS: Mapping[str, Any] = {
    "number": _format_number,
    "number_with_unit": number_with_unit,
    "with_unit": with_unit,
    "setting": setting_text,
    "settings": settings_text,
    "percent": format_percent,
}
