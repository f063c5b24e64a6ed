"""Maps as Vega-Lite: fractions of labels, or one number a cell; and those of a baseline beside."""

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import altair as alt
import numpy as np
from numpy.typing import NDArray

from contactlab.charts import (
    Rows,
    Spec,
    haloed,
    layer_of,
    themed,
    word_colours,
)
from contactlab.comparison.compare_stores import DEFAULT_POLICY, compare, pair_runs
from contactlab.comparison.pairing import Pairing
from contactlab.contact.trace_arrays import Floats
from contactlab.page.inferred_cells import NOT_INFERRED, agreed
from contactlab.page.map_cells import (
    cell_statistic,
    label_counts,
    most_frequent_failure,
)
from contactlab.palette import COLOURS, INK, UNCHANGED_COLOUR
from contactlab.printable import shell_word
from contactlab.reporting.map_axes import MapAxes
from contactlab.reporting.report import ReportData
from contactlab.reporting.report_columns import (
    Codes,
    Quantities,
    Quantity,
    RunLabels,
    read_run_labels,
    summary_metrics,
)
from contactlab.schema.comparison import ComparisonReport
from contactlab.schema.evidence import LabelFacts
from contactlab.schema.finding import Finding, Outcome
from contactlab.store.finished_store import Store

Layered = alt.LayerChart | alt.FacetChart
Room = tuple[int, int]

_ROOM: Room = 560, 340
_THIRD: Room = 300, 260
_PANELS = ("baseline", "candidate", "difference")
_LISTED: tuple[Outcome, ...] = ("failed", "warned", "noted")
_CELL_WIDTH, _CELL_HEIGHT = (13, 112), (13, 56)
_GAP = 0.03
_DIVERGING = ["#1845fb", "#f4f4f4", "#ff5e02"]
_LEAST_RATIO = 1.02
_EDGE = 0.2
_PALE = 0.35
_FENCE = 1.5
_MOST_TEXTS_OF_A_ROW = 12
_SPANS_DECADES = 30.0


def _clipped(value: float, limits: tuple[float, float]) -> float:
    return min(max(value, limits[0]), limits[1])


def default_map(data: ReportData) -> Spec | None:
    """Return the map of labels over the two most informative axes; None without axes."""
    if data.map_axes is None:
        return None
    expected = data.quantities_named("oracle_expected")
    boundary = [
        row for expectation in expected for row in boundary_rows(data.map_axes, expectation)
    ]
    inferred = agreed(data, data.map_axes)
    made = label_map(data.map_axes, data.labels, boundary=boundary, inferred=inferred)
    return themed(made.to_dict())


def metric_map(data: ReportData, name: str) -> Spec | None:
    """Return the map of the worst values of a metric; None without axes, or values."""
    axes = data.map_axes
    for quantity in data.quantities_named(name):
        if axes is not None:
            values = cell_statistic(axes, quantity, "worst")
            title, resolution = f"worst {quantity.title}", quantity.column.resolution
            return themed(number_map(axes, values, title, resolution).to_dict())
    return None


def label_rows(counts: NDArray[np.int64], labels: RunLabels) -> tuple[Rows, Rows]:
    """Return the pieces of each cell, as wide as their fraction of runs, and their letters.

    They are of `counts` (rows, columns, labels).
    """
    main = most_frequent_failure(counts, labels)
    pieces: Rows = []
    letters: Rows = []
    for y, x in np.argwhere(counts.any(axis=-1)).tolist():
        ends = np.concatenate(([0], counts[y, x].cumsum())) / counts[y, x].sum()
        for code in np.flatnonzero(counts[y, x]).tolist():
            start, stop = ends[code : code + 2].tolist()
            pieces.append(_piece(x, y, start, stop) | {"label": labels.legend[code]})
            if code == main[y, x]:
                place = x + _clipped((start + stop) / 2, (_EDGE, 1 - _EDGE))
                letters.append({"x": place, "y": y + 0.5, "text": labels.letters[code]})
    return pieces, letters


def _piece(x: int, y: int, start: float, stop: float) -> dict[str, Any]:
    width = 1 - 2 * _GAP
    return {
        "x": round(x + _GAP + start * width, 6),
        "x2": round(x + _GAP + stop * width, 6),
        "y": y + _GAP,
        "y2": y + 1 - _GAP,
    }


def boundary_rows(axes: MapAxes, expected: Quantity) -> Rows:
    """Return the ends of lines between two cells of which one only has an expectation of zero."""
    values = cell_statistic(axes, expected, "worst")
    rows: Rows = []
    for step in ((0, 1), (1, 0)):
        before, after = values[: -step[0] or None, : -step[1] or None], values[step[0] :, step[1] :]
        parts = np.isfinite(before) & np.isfinite(after) & ((before == 0) != (after == 0))
        for y, x in (np.argwhere(parts) + step).tolist():
            ends = enumerate(((x, y), (x + step[0], y + step[1])))
            part = f"{x} {y} {step[0]}"
            rows += [{"x": x, "y": y, "order": order, "part": part} for order, (x, y) in ends]
    return rows


def number_rows(values: Floats) -> tuple[Rows, Rows]:
    """Return a piece for each cell that has a value, and the values as text where they fit."""
    cells = np.argwhere(np.isfinite(values)).tolist()
    pieces = [_piece(x, y, 0, 1) | {"value": float(values[y, x])} for y, x in cells]
    if values.shape[1] > _MOST_TEXTS_OF_A_ROW:
        return pieces, []
    texts = [{"x": x + 0.5, "y": y + 0.5, "text": f"{values[y, x]:.3g}"} for y, x in cells]
    return pieces, texts


def label_map(
    axes: MapAxes | None,
    labels: RunLabels,
    room: Room = _ROOM,
    boundary: Rows | None = None,
    inferred: Codes | None = None,
) -> Layered:
    """Return the map of labels, with a closed form's boundary if there is one; empty without axes.

    The room is the width and height that are available [pixels]. Cells without a run have, paler,
    the labels that are inferred for them (rows, columns), if any are.
    """
    pieces, letters = label_rows(label_counts(axes, labels), labels) if axes else ([], [])
    used = {row["label"] for row in pieces}
    shown = [name for name in labels.legend if name in used]
    colour = word_colours("label", labels.legend, labels.colours)
    colour = colour.legend(title="label", values=shown)
    rows = _MapRows(pieces, letters, boundary or [], _inferred_rows(inferred, labels))
    return _layered(axes, room, rows, colour, 13)


def _inferred_rows(inferred: Codes | None, labels: RunLabels) -> Rows:
    """Return a piece for each cell whose label is inferred."""
    if inferred is None:
        return []
    cells = np.argwhere(inferred != NOT_INFERRED).tolist()
    return [_piece(x, y, 0, 1) | {"label": labels.legend[inferred[y, x]]} for y, x in cells]


def number_map(
    axes: MapAxes | None,
    values: Floats,
    title: str,
    resolution: float = 0.0,
    room: Room = _ROOM,
    beside: Floats | None = None,
) -> Layered:
    """Return the map of a number (rows, columns), NaN where there is none; empty without axes.

    It has the colours of any values `beside`, which are of another map.
    """
    scaled = values if beside is None else np.concatenate([values, beside])
    scale = number_scale(scaled[np.isfinite(scaled)].tolist(), resolution)
    colour = alt.Color("value:Q").scale(scheme="cividis", **scale)
    return _number_layers(axes, room, values, colour, title)


def ratio_map(axes: MapAxes, ratios: Floats, title: str, room: Room) -> Layered:
    """Return the map of a ratio (rows, columns), with 1 in the middle of the colour scale."""
    sizes = np.abs(np.log(ratios[np.isfinite(ratios)]))
    reach = math.exp(sizes.max(initial=math.log(_LEAST_RATIO)))
    colour = alt.Color("value:Q")
    colour = colour.scale(type="log", domain=[1 / reach, reach], range=_DIVERGING, nice=False)
    return _number_layers(axes, room, ratios, colour, f"candidate / baseline, {title}")


def _number_layers(
    axes: MapAxes | None, room: Room, values: Floats, colour: alt.Color, title: str
) -> Layered:
    colour = colour.legend(title=title, format=".3~g", gradientLength=160)
    return _layered(axes, room, _MapRows(*number_rows(values)), colour, 10)


def number_scale(values: Sequence[float], resolution: float) -> dict[str, Any]:
    """Return a logarithmic scale for positive numbers that span decades, else a linear one.

    A number beyond Tukey's fences, 1.5 interquartile ranges from the quartiles, has the colour of
    the end, so that one outlier does not take all colours. So has a zero on a logarithmic scale.
    """
    sizes = sorted(value for value in values if value > resolution)
    shared: dict[str, Any] = {"clamp": True, "nice": False}
    if not sizes or min(values) < 0 or sizes[-1] < _SPANS_DECADES * sizes[0]:
        return {"type": "linear", "zero": False, "domain": _within_fences(values), **shared}
    low, high = _within_fences([math.log(size) for size in sizes])
    return {"type": "log", "domain": [math.exp(low), math.exp(high)], **shared}


def _within_fences(values: Sequence[float]) -> list[float]:
    """Return the least and the greatest value that is no outlier; all count if half are equal."""
    if not values:
        return [0.0, 1.0]
    first, third = np.quantile(values, (0.25, 0.75))
    reach = _FENCE * (third - first) or math.inf
    return [max(min(values), float(first - reach)), min(max(values), float(third + reach))]


class _MapRows(NamedTuple):
    """The rows of a map's layers: cells, texts, a boundary's ends, and cells without runs."""

    cells: Rows
    texts: Rows
    boundary: Sequence[dict[str, Any]] = ()
    # None of numbers, of which nothing is inferred.
    inferred: Sequence[dict[str, Any]] | None = None


def _layered(
    axes: MapAxes | None, room: Room, rows: _MapRows, colour: alt.Color, font_size: int
) -> Layered:
    """Return the layers of a map: cells and texts, which are its rows, and what lies over them."""
    columns, lines = (axes.x.ticks, axes.y.ticks if axes.y else ("",)) if axes else ((), ())
    x = alt.X("x:Q").scale(domain=[0, len(columns)], nice=False, zero=False)
    y = alt.Y("y:Q").scale(domain=[0, len(lines)], nice=False, zero=False)
    cell = _clipped(room[0] / max(1, len(columns)), _CELL_WIDTH)
    width = cell * max(1, len(columns))
    height = _clipped(room[1] / max(1, len(lines)), _CELL_HEIGHT) * max(1, len(lines))
    # Tick labels below the map turn where a cell is too narrow.
    angle = -35 if max(map(len, columns), default=0) * 7 > cell else 0
    x = x.axis(title=axes.x.title if axes else "", **_ticks(columns), labelAngle=angle)
    y_title = "" if axes is None else axes.y.title if axes.y else None
    y = y.axis(title=y_title, titlePadding=12, **_ticks(lines))
    cells = layer_of("cells", rows.cells).mark_rect().encode(x, y, colour, x2="x2:Q", y2="y2:Q")
    bold = haloed(layer_of("texts", rows.texts), fontWeight="bold", fontSize=font_size)
    words = [layer.encode(x, y, text="text:N") for layer in bold]
    edge = layer_of("boundary", [*rows.boundary])
    edge = edge.mark_line(color=INK, strokeWidth=2.5, strokeDash=[6, 3])
    edge = edge.encode(x, y, order="order:Q", detail="part:N")
    focus = layer_of("ring", []).mark_rect(fill=None, stroke=INK, strokeWidth=3)
    paler: list[alt.Chart] = []
    if rows.inferred is not None:
        layer = layer_of("inferred", [*rows.inferred]).mark_rect(opacity=_PALE)
        paler = [layer.encode(x, y, colour.legend(None), x2="x2:Q", y2="y2:Q")]
    layers = (cells, *paler, *words, edge, focus.encode(x, y, x2="x2:Q", y2="y2:Q"))
    return alt.layer(*layers).properties(width=width, height=height)


def _ticks(ticks: Sequence[str]) -> dict[str, Any]:
    """Return an axis with a tick label in the middle of each cell."""
    return {
        "values": [index + 0.5 for index in range(len(ticks))],
        "labelExpr": f"{json.dumps(list(ticks))}[floor(datum.value)]",
        "labelOverlap": True,
        "labelLimit": 140,
        "grid": False,
        "ticks": False,
        "domain": False,
    }


class BaselineComparison(NamedTuple):
    """A comparison as a page shows it: its findings, the failed ones first, and maps by name."""

    report: ComparisonReport
    findings: tuple[Finding, ...]
    maps: dict[str, Spec]
    command: str


def compare_with_baseline(data: ReportData, baseline: Store) -> BaselineComparison:
    """Compare a store with a baseline; a StoreError says that one is damaged, or no run shared."""
    store = data.store
    ids, other = (side.columns.byte_strings("run_id") for side in (baseline, store))
    # Runs are paired by axes where no id is shared.
    match = "id" if np.isin(ids, other).any() else "axes"
    policy = DEFAULT_POLICY.model_copy(update={"match": match})
    report = compare(baseline.address, store.address, policy)
    pairing = pair_runs(baseline, store, policy)
    option = "" if policy.match == "id" else " --match axes"
    return BaselineComparison(
        report=report,
        findings=tuple(
            check for outcome in _LISTED for check in report.findings if check.outcome == outcome
        ),
        maps=dict(_maps(data, baseline, pairing)),
        command=f"contactlab compare {shell_word(baseline.address)} "
        f"{shell_word(store.address)}{option}",
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
    name = data.tradeoff.error.name if data.tradeoff else summary_metrics()[0]
    for quantity in data.quantities_named(name):
        for earlier in Quantities.of(baseline.columns).named([name]):
            old_values = replace(earlier, values=earlier.values[before])
            new_values = replace(quantity, values=quantity.values[after])
            yield name, _number_maps(axes, old_values, new_values)


def _labels_of(store: Store, names: Sequence[str], rows: NDArray[np.intp]) -> RunLabels:
    labels = read_run_labels(store, names)
    return replace(labels, codes=labels.codes[rows], masks=labels.masks[rows])


def _label_maps(axes: MapAxes, before: RunLabels, after: RunLabels) -> Spec:
    # In the order of the names: labels are ordered worst first.
    moved = np.select([after.codes < before.codes, after.codes > before.codes], [0, 1], 2)
    change = replace(
        after,
        names=("worse", "better", "as before"),
        letters=("W", "B", ""),
        facts=tuple(map(_painted, (COLOURS[1], COLOURS[0], UNCHANGED_COLOUR))),
        codes=moved,
    )
    return _side_by_side([label_map(axes, labels, _THIRD) for labels in (before, after, change)])


def _painted(colour: str) -> LabelFacts:
    return LabelFacts(colour=colour)


def _number_maps(axes: MapAxes, before: Quantity, after: Quantity) -> Spec:
    values = [cell_statistic(axes, side, "worst") for side in (before, after)]
    title, resolution = f"worst {after.title}", after.column.resolution
    panels = [
        number_map(axes, own, title, resolution, _THIRD, other)
        for own, other in (values, values[::-1])
    ]
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
