"""Figures for papers: the charts of a page, and some that it has no room for, such as impacts."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

import altair as alt
import numpy as np

from contactlab.charts import Rows, Spec, apply_theme, layer_of, word_colours
from contactlab.contact.contact_laws import damping_ratio, restitution_from_damping, sticking_speed
from contactlab.contact.trace_arrays import LINEAR_VELOCITY, STICK, Floats
from contactlab.errors import optional
from contactlab.measure import labels_with
from contactlab.page.heatmap import default_map, metric_map
from contactlab.page.map_cells import cell_statistic
from contactlab.page.page_charts import change_panels, knob_changes, tradeoff_chart
from contactlab.page.run_series import is_single_body, qpos_entries, thin_indices
from contactlab.page.stick_or_slip import slope_runs, stick_slip_panel
from contactlab.palette import COLOURS, INK, SHAPES
from contactlab.reporting.map_axes import MapAxes
from contactlab.reporting.report import ReportData
from contactlab.reporting.report_columns import (
    GridAxis,
    Quantity,
    combination_codes,
    number_with_unit,
)
from contactlab.schema.evidence import EvidenceRecord
from contactlab.store.finished_store import Store
from contactlab.store.mcap.trace_reader import StoredPair, StoredTrace


@dataclass(frozen=True)
class _FigureRules:
    """Which runs a figure for papers shows, and how many."""

    most_bouncing_runs: int = 6
    most_bouncing_records: int = 200
    least_peaks: int = 2
    # Peaks below this fraction of the fall are lost in the contact's own depth.
    least_peak_share: float = 0.02
    # Ground that rises by a larger share of the fall is a slope.
    most_rise: float = 0.1
    most_impact_records: int = 600
    least_impacts: int = 3
    translations: int = 3  # degrees of freedom of a body that cannot turn
    # Bodies that approach more slowly rest on each other, without impact [m/s].
    least_approach_m_per_s: float = 0.05


_RULES = _FigureRules()

_NO_BOUNCE = "no stable run with a trace is of a single free body that bounces on level ground"
_NO_CONE = (
    "fewer than three runs with a trace begin with an oblique impact of a body that cannot turn"
)
_NO_SLOPE = (
    "fewer than three runs with a trace are of a single body that starts at rest on a plane under "
    "a constant load"
)
FIGURES = {
    "labels": "the map of labels over the two most informative axes",
    "error": "the same map of the error",
    "work-precision": "error against time",
    "bounces": "height over time, and the ratio of heights at each bounce",
    "cone": "first impacts in velocity space, with the boundary of the friction cone",
    "stick-slip": "stick or slip over the load's angle and friction, with the friction cone",
    "effects": "the factor by which each change of one knob multiplies time and error",
}
_OUTCOMES = ["sticks", "slides throughout"]


@dataclass(frozen=True)
class BouncingRun:
    """One run that bounces: the setting that distinguishes it, and its contact's restitution.

    Over times (P,) [s] it has heights (P,) above the first contact [m]. The peaks (B + 1,) are its
    greatest heights before the first bounce, and after each [m].
    """

    setting: str
    time: Floats
    height: Floats
    peaks: Floats
    restitution: float

    @property
    def ratios(self) -> Floats:
        """(B,) height after each bounce over the height before; e^2 without loss in flight."""
        return self.peaks[1:] / self.peaks[:-1]


def bouncing_runs(
    store: Store, axes: Sequence[GridAxis], stable: np.ndarray
) -> tuple[list[BouncingRun], str]:
    """Return `stable` (n,) runs that bounce and differ in one axis, and the others' values.

    These values are the ones with most such runs.
    """
    axis = _axis_of_restitution(store, axes, stable)
    others = [each for each in axes if each is not axis]
    rows = np.flatnonzero(stable & store.columns.has_value("trace_file"))
    cases = combination_codes(others, store.columns.runs)[rows]
    # The largest case first; of equal ones that of the first run.
    sizes = Counter(cases.tolist())
    best, shared, left = list[BouncingRun](), "", _RULES.most_bouncing_records
    for case in sorted(sizes, key=lambda case: -sizes[case]):
        if len(best) >= min(sizes[case], _RULES.most_bouncing_runs):
            break
        own = rows[cases == case][:left].tolist()
        left -= len(own)
        runs = list(_bouncing_runs_of(store, own, axis))
        if len(runs) > len(best):
            best, row = runs, own[0]
            values = (number_with_unit(each.ticks[each.codes[row]], each.unit) for each in others)
            shared = ", ".join(
                f"{each.name} {value}" for each, value in zip(others, values, strict=True)
            )
    return best, shared


def _bouncing_runs_of(
    store: Store, rows: Sequence[int], axis: GridAxis | None
) -> Iterator[BouncingRun]:
    for row in rows[: _RULES.most_bouncing_runs]:
        setting = "the scene's own"
        if axis is not None:
            value = number_with_unit(axis.ticks[axis.codes[row]], axis.unit)
            setting = f"{axis.name} {value}"
        record = store.record_at(row)
        run = _bouncing_run(store.trace(record), record, setting)
        if run is not None:
            yield run


def _axis_of_restitution(
    store: Store, axes: Sequence[GridAxis], stable: np.ndarray
) -> GridAxis | None:
    """Return the axis with the largest spread of measured restitution in stable runs."""
    if not axes or "restitution_measured" not in store.columns.schema.names:
        return None
    values = store.columns.numbers("restitution_measured").values
    restitution = Quantity(
        store.columns.described["restitution_measured"], np.where(stable, values, np.nan)
    )

    def spread(axis: GridAxis) -> float:
        means = cell_statistic(MapAxes(axis, None), restitution, "median")
        finite_means = means[np.isfinite(means)].tolist()
        return max(finite_means, default=0.0) - min(finite_means, default=0.0)

    return max(axes, key=spread)


def _bouncing_run(trace: StoredTrace, record: EvidenceRecord, setting: str) -> BouncingRun | None:
    entries = qpos_entries(trace.model_xml, trace.qpos.shape[1])
    heights = [entry for entry in entries if entry.is_height]
    if not heights or not is_single_body(trace) or not trace.pairs or not len(trace.pairs[0].steps):
        return None
    pair = trace.pairs[0]
    height = trace.qpos[:, heights[0].index] - trace.qpos[pair.steps[0], heights[0].index]
    # The greatest height of each flight that ends in the trace.
    gaps = np.flatnonzero(np.diff(pair.steps) > 1)
    flights = zip([0, *pair.steps[gaps]], [pair.steps[0], *pair.steps[gaps + 1]], strict=True)
    peaks = np.array([height[start : end + 1].max() for start, end in flights])
    low = np.flatnonzero(peaks < _RULES.least_peak_share * peaks[0])
    peaks = peaks[: low[0]] if len(low) else peaks
    # On a slope a body leaves the ground lower than it came.
    grounds = height[pair.steps[gaps + 1]]
    if (
        len(peaks) < _RULES.least_peaks
        or np.abs(grounds).max(initial=0.0) > _RULES.most_rise * peaks[0]
    ):
        return None
    rows = thin_indices(height)
    restitution = float(restitution_from_damping(damping_ratio(record.pairs[pair.name].solref)))
    return BouncingRun(setting, trace.time[rows], height[rows], peaks, restitution)


def first_impacts(store: Store) -> Rows:
    """Return the first impacts of traced runs; none unless at least three of them slip.

    They are impacts of bodies that cannot turn, because turning would change the bound. Each has
    its `engine`, the `slip` before it [m/s], the largest slip that Coulomb friction stops, mu (1 +
    e) v_n, as `bound` [m/s], and whether the `contact` sticks at any step of it.
    """
    if store.manifest.traces_left_out or store.manifest.traces < _RULES.least_impacts:
        return []
    without = labels_with("no impact")
    records = (
        record
        for record in store.records(store.columns.has_value("trace_file"))
        if record.label not in without
    )
    impacts: Rows = []
    for record in islice(records, _RULES.most_impact_records):
        trace = store.trace(record)
        if is_single_body(trace) and trace.qpos.shape[1] == _RULES.translations:
            for pair in trace.pairs[:1]:
                impacts += _first_impact(pair, record)
    slipping = [impact for impact in impacts if impact["slip"] > 0]
    return impacts if len(slipping) >= _RULES.least_impacts else []


def _first_impact(pair: StoredPair, record: EvidenceRecord) -> Rows:
    contact = record.pairs[pair.name]
    if not len(pair.points) or contact.condim < 3:
        return []
    velocity = pair.points[0, LINEAR_VELOCITY]
    normal, slip = abs(float(velocity[0])), float(np.linalg.norm(velocity[1:]))
    if normal < _RULES.least_approach_m_per_s:
        return []
    restitution = restitution_from_damping(damping_ratio(contact.solref))
    bound = float(sticking_speed(normal, restitution, contact.friction[0]))
    # The first touch only: after a flight another one follows.
    breaks = np.flatnonzero(np.diff(pair.steps) > 1)
    first = pair.mode[: breaks[0] + 1] if len(breaks) else pair.mode
    outcome = _OUTCOMES[0] if (first == STICK).any() else _OUTCOMES[1]
    engine = str(record.settings["engine"])
    return [{"bound": bound, "slip": slip, "engine": engine, "contact": outcome}]


def bounce_panels(runs: Sequence[BouncingRun], shared: str) -> Spec:
    """Return height over time, and the ratio of heights at each bounce next to e^2.

    The title of the left one has the shared values of all other axes.
    """
    names = [run.setting for run in runs]
    colour = word_colours("setting", names, COLOURS[: len(names)]).legend(title=None)
    heights: Rows = [
        {"time": time, "height": height, "setting": run.setting}
        for run in runs
        for time, height in zip(run.time.tolist(), run.height.tolist(), strict=True)
    ]
    left = (
        layer_of("heights", heights)
        .mark_line(strokeWidth=1.4)
        .encode(
            alt.X("time:Q").scale(nice=False).axis(title="time [s]"),
            alt.Y("height:Q").axis(title="height above first contact [m]"),
            colour,
        )
        .properties(width=420, height=260)
    )
    small: dict[str, Any] = {"fontSize": 11, "fontWeight": "normal"}
    if shared:
        left = left.properties(title=alt.TitleParams(f"all at {shared}", **small))
    # The ratio of heights at each bounce, next to e^2.
    ratios: Rows = [
        {"bounce": index + 1, "ratio": ratio, "setting": run.setting}
        for run in runs
        for index, ratio in enumerate(run.ratios.tolist())
    ]
    most = max(row["bounce"] for row in ratios)
    rules: Rows = [{"ratio": run.restitution**2, "setting": run.setting} for run in runs]
    y = alt.Y("ratio:Q").scale(zero=True).axis(title="height after a bounce / before")
    shape = alt.Shape("setting:N").scale(domain=names, range=list(SHAPES[: len(names)]))
    points = (
        layer_of("ratios", ratios)
        .mark_point(size=55, filled=True, opacity=1)
        .encode(
            alt.X("bounce:Q")
            .scale(domain=[0.5, most + 0.5], nice=False)
            .axis(title="bounce", values=list(range(1, most + 1)), format="d"),
            y,
            colour,
            shape.legend(None),
        )
    )
    lines = layer_of("squares", rules).mark_rule(strokeDash=[5, 4], strokeWidth=1.3)
    title = alt.TitleParams("dashed: e² of the contact", **small)
    right = alt.layer(lines.encode(y, colour), points)
    right = right.properties(width=260, height=260, title=title)
    return alt.hconcat(left, right, spacing=30).to_dict()


def cone_panel(impacts: Rows) -> Spec:
    """Return impacts in velocity space, with the boundary of Coulomb's cone."""
    most = max(impact["bound"] for impact in impacts) * 1.08
    highest = max(impact["slip"] for impact in impacts) * 1.05
    x = alt.X("bound:Q").scale(domain=[0, most], nice=False)
    y = alt.Y("slip:Q").scale(domain=[0, highest], nice=False)
    x = x.axis(title="μ (1 + e) · normal speed before the impact [m/s]")
    y = y.axis(title="tangential speed before the impact [m/s]")
    colour = word_colours("contact", _OUTCOMES, COLOURS[:2]).legend(title=None)
    shape = alt.Shape("contact:N").scale(domain=_OUTCOMES, range=["circle", "triangle-up"])
    end = min(most, highest)
    line_ends = [
        {"bound": value, "slip": value, "line": True, "engine": engine}
        for engine in dict.fromkeys(impact["engine"] for impact in impacts)
        for value in (0.0, end)
    ]
    base = layer_of("impacts", [*impacts, *line_ends])
    points = (
        base.transform_filter("!datum.line")
        .mark_point(size=60, filled=True, opacity=0.75)
        .encode(x, y, colour, shape.legend(title=None))
    )
    line = base.transform_filter("datum.line").mark_line(color=INK, strokeDash=[6, 4])
    chart = alt.layer(line.encode(x, y), points).properties(width=300, height=300)
    title = alt.Header(title="dashed: the cone's boundary; engine", titleFontWeight="normal")
    return chart.facet(column=alt.Column("engine:N").header(title)).to_dict()


def figure_files(
    data: ReportData, formats: Sequence[str], width: str | None = None
) -> tuple[dict[str, bytes], dict[str, str]]:
    """Return the figures of a store by file name, and the reasons why others are missing.

    A width, as in `85mm`, lays them out for paper; an OutputError says if it is not a width.
    """
    with optional("figures", "figures for paper"):
        from contactlab.page.paper_size import parse_width, render_at  # noqa: PLC0415 - an extra
    millimetres = None if width is None else parse_width(width)
    specs = figure_specs(data)
    files = {
        f"{name}.{form}": render_at(spec, form, millimetres)
        for name, spec in specs.items()
        if not isinstance(spec, str)
        for form in formats
    }
    return files, {name: spec for name, spec in specs.items() if isinstance(spec, str)}


def figure_list(data: ReportData) -> list[tuple[str, str]]:
    """Return each figure's name, and its description or the reason why it is missing."""
    specs = figure_specs(data).items()
    return [
        (name, f"none: {spec}" if isinstance(spec, str) else FIGURES[name]) for name, spec in specs
    ]


def figure_specs(data: ReportData) -> dict[str, Spec | str]:
    """Return the specification of each figure, by name, or the reason why it is missing."""
    physical = physical_figures(data)
    error_map = metric_map(data, data.tradeoff.error.name) if data.tradeoff else None
    # The effects of changing one knob.
    report = data.tradeoff
    names = [report.time.name, report.error.name] if report else ["cost_cpu_per_sim_s"]
    quantities = data.quantities.select_named(names)
    changes = knob_changes(data.axes, data.labels, quantities, len(names))
    changes = [change for change in changes if any(change.ratios.values())]
    return {
        "labels": default_map(data) or "the runs differ in no axis",
        "error": error_map or data.no_tradeoff or "the runs differ in no axis",
        "work-precision": tradeoff_chart(data) or data.no_tradeoff or "nothing was timed",
        "bounces": physical["Height over time"] or _NO_BOUNCE,
        "cone": physical["Impacts and the friction cone"] or _NO_CONE,
        "stick-slip": physical["Stick or slip over angle and friction"] or _NO_SLOPE,
        "effects": apply_theme(change_panels(changes, names))
        if changes
        else "no two runs differ in one knob only",
    }


def physical_figures(data: ReportData) -> dict[str, Spec | None]:
    """Return the figures of moving bodies, by title; None if the store has no such runs."""
    bouncing, shared = bouncing_runs(data.store, data.axes, ~data.labels.failed)
    impacts, slopes = first_impacts(data.store), slope_runs(data.store)
    return {
        "Height over time": apply_theme(bounce_panels(bouncing, shared)) if bouncing else None,
        "Impacts and the friction cone": apply_theme(cone_panel(impacts)) if impacts else None,
        "Stick or slip over angle and friction": apply_theme(stick_slip_panel(slopes))
        if slopes
        else None,
    }
