"""Maps as Vega-Lite: fractions of labels, or one number a cell, and those of a baseline."""

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import altair as alt
import numpy as np
from numpy.typing import NDArray

from contactlab.charts import (
    Rows,
    Spec,
    apply_theme,
    halo_layers,
    layer_of,
    word_colours,
)
from contactlab.comparison.compare_stores import DEFAULT_POLICY, compare_stores, match_runs
from contactlab.comparison.pairing import Pairing
from contactlab.contact.trace_arrays import Floats
from contactlab.page.inferred_cells import NOT_INFERRED, agreed_labels
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


@dataclass(frozen=True)
class _MapLook:
    """Sizes [pixels], shares and limits of maps."""

    room: Room = 560, 340
    third: Room = 300, 260
    gap: float = 0.03
    least_ratio: float = 1.02
    edge: float = 0.2
    pale: float = 0.35
    fence: float = 1.5
    most_texts: int = 12
    decades: float = 30.0


_LOOK = _MapLook()

_PANELS = ("baseline", "candidate", "difference")
_LISTED: tuple[Outcome, ...] = ("failed", "warned", "noted")
# A page replaces hexadecimal colors by variables of its style, which no scale can mix.
DIVERGING_COLORS = ["rgb(24, 69, 251)", "rgb(244, 244, 244)", "rgb(255, 94, 2)"]


def _clip_value(value: float, limits: tuple[float, float]) -> float:
    return min(max(value, limits[0]), limits[1])


def default_map(data: ReportData) -> Spec | None:
    """Return the map of labels over the two most informative axes; None without axes."""
    if data.map_axes is None:
        return None
    expected = data.quantities_named("oracle_expected")
    boundary = [
        row for expectation in expected for row in boundary_rows(data.map_axes, expectation)
    ]
    inferred = agreed_labels(data, data.map_axes)
    chart = label_map(data.map_axes, data.labels, boundary=boundary, inferred=inferred)
    return apply_theme(chart.to_dict(validate=False))


def metric_map(data: ReportData, name: str) -> Spec | None:
    """Return the map of the worst values of a metric; None without axes, or values."""
    axes = data.map_axes
    for quantity in data.quantities_named(name):
        if axes is not None:
            values = cell_statistic(axes, quantity, "worst")
            title, resolution = f"worst {quantity.title}", quantity.column.resolution
            return apply_theme(number_map(axes, values, title, resolution).to_dict(validate=False))
    return None


def label_rows(counts: NDArray[np.int64], labels: RunLabels) -> tuple[Rows, Rows]:
    """Return the pieces of each cell, as wide as their fraction of runs, and their letters.

    They are of `counts` (rows, columns, labels). In print, the letters tell colors apart: the most
    frequent failure of a cell has one, and others that are wide enough.
    """
    main = most_frequent_failure(counts, labels)
    least_share = 0.25 if counts.shape[1] <= _LOOK.most_texts else 1.0  # of a cell, for a letter
    pieces: Rows = []
    letters: Rows = []
    for y, x in np.argwhere(counts.any(axis=-1)).tolist():
        ends = np.concatenate(([0], counts[y, x].cumsum())) / counts[y, x].sum()
        for code in np.flatnonzero(counts[y, x]).tolist():
            start, stop = ends[code : code + 2].tolist()
            pieces.append(_cell_piece(x, y, start, stop) | {"label": labels.legend[code]})
            if code == main[y, x] or (labels.letters[code] and stop - start >= least_share):
                place = x + _clip_value((start + stop) / 2, (_LOOK.edge, 1 - _LOOK.edge))
                letters.append({"x": place, "y": y + 0.5, "text": labels.letters[code]})
    return pieces, letters


def _cell_piece(x: int, y: int, start: float, stop: float) -> dict[str, Any]:
    width = 1 - 2 * _LOOK.gap
    return {
        "x": round(x + _LOOK.gap + start * width, 6),
        "x2": round(x + _LOOK.gap + stop * width, 6),
        "y": y + _LOOK.gap,
        "y2": y + 1 - _LOOK.gap,
    }


def boundary_rows(axes: MapAxes, expected: Quantity) -> Rows:
    """Return the ends of lines between two cells if only one of them has an expectation of zero."""
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
    pieces = [_cell_piece(x, y, 0, 1) | {"value": float(values[y, x])} for y, x in cells]
    if values.shape[1] > _LOOK.most_texts:
        return pieces, []
    texts = [{"x": x + 0.5, "y": y + 0.5, "text": f"{values[y, x]:.3g}"} for y, x in cells]
    return pieces, texts


def label_map(
    axes: MapAxes | None,
    labels: RunLabels,
    room: Room = _LOOK.room,
    boundary: Rows | None = None,
    inferred: Codes | None = None,
) -> Layered:
    """Return the map of labels, with a closed form's boundary if there is one; empty without axes.

    The room is the width and height that are available [pixels]. Cells without a run have, paler,
    the labels that are inferred for them (rows, columns), if any are.
    """
    pieces, letters = label_rows(label_counts(axes, labels), labels) if axes else ([], [])
    drawn_labels = {row["label"] for row in pieces}
    legend_names = [name for name in labels.legend if name in drawn_labels]
    colour = word_colours("label", labels.legend, labels.colours)
    colour = colour.legend(title="label", values=legend_names)
    inferred_pieces: Rows = []
    if inferred is not None:
        for y, x in np.argwhere(inferred != NOT_INFERRED).tolist():
            label = labels.legend[inferred[y, x]]
            inferred_pieces.append(_cell_piece(x, y, 0, 1) | {"label": label})
            letter = labels.letters[inferred[y, x]]
            letters += [{"x": x + 0.5, "y": y + 0.5, "text": letter}] if letter else []
    rows = _MapRows(pieces, letters, boundary or [], inferred_pieces)
    return _layer_map(axes, room, rows, colour, 13)


def number_map(
    axes: MapAxes | None,
    values: Floats,
    title: str,
    resolution: float = 0.0,
    room: Room = _LOOK.room,
    other_values: Floats | None = None,
) -> Layered:
    """Return the map of a number (rows, columns), NaN for a cell without one; empty without axes.

    `other_values` are those of another map with the same colours.
    """
    scaled = values if other_values is None else np.concatenate([values, other_values])
    scale = number_scale(scaled[np.isfinite(scaled)].tolist(), resolution)
    colour = alt.Color("value:Q").scale(scheme="cividis", **scale)
    return _number_layers(axes, room, values, colour, title)


def ratio_map(axes: MapAxes, ratios: Floats, title: str, room: Room) -> Layered:
    """Return the map of a ratio (rows, columns), with 1 in the middle of the color scale."""
    sizes = np.abs(np.log(ratios[np.isfinite(ratios)]))
    reach = math.exp(sizes.max(initial=math.log(_LOOK.least_ratio)))
    colour = alt.Color("value:Q")
    colour = colour.scale(type="log", domain=[1 / reach, reach], range=DIVERGING_COLORS, nice=False)
    return _number_layers(axes, room, ratios, colour, f"candidate / baseline, {title}")


def _number_layers(
    axes: MapAxes | None, room: Room, values: Floats, colour: alt.Color, title: str
) -> Layered:
    colour = colour.legend(title=title, format=".3~g", gradientLength=160)
    return _layer_map(axes, room, _MapRows(*number_rows(values)), colour, 10)


def number_scale(values: Sequence[float], resolution: float) -> dict[str, Any]:
    """Return a logarithmic scale for positive numbers that span decades, otherwise a linear one.

    A number beyond Tukey's fences, 1.5 interquartile ranges from the quartiles, has the color of
    the end, so that one outlier does not take all colours. So has a zero on a logarithmic scale.
    """
    sizes = sorted(value for value in values if value > resolution)
    shared: dict[str, Any] = {"clamp": True, "nice": False}
    if not sizes or min(values) < 0 or sizes[-1] < _LOOK.decades * sizes[0]:
        return {"type": "linear", "zero": False, "domain": _within_fences(values), **shared}
    low, high = _within_fences([math.log(size) for size in sizes])
    return {"type": "log", "domain": [math.exp(low), math.exp(high)], **shared}


def _within_fences(values: Sequence[float]) -> list[float]:
    """Return the least and the greatest value without outliers; all count if half are equal."""
    if not values:
        return [0.0, 1.0]
    first, third = np.quantile(values, (0.25, 0.75))
    reach = _LOOK.fence * (third - first) or math.inf
    return [max(min(values), float(first - reach)), min(max(values), float(third + reach))]


class _MapRows(NamedTuple):
    """The rows of a map's layers: cells, texts, a boundary's ends, and cells without runs."""

    cells: Rows
    texts: Rows
    boundary: Sequence[dict[str, Any]] = ()
    # None for numbers, which are never inferred.
    inferred: Sequence[dict[str, Any]] | None = None


def _layer_map(
    axes: MapAxes | None, room: Room, rows: _MapRows, colour: alt.Color, font_size: int
) -> Layered:
    """Return the layers of a map: cells and texts, its rows, and the layers over them."""
    columns, lines = (axes.x.ticks, axes.y.ticks if axes.y else ("",)) if axes else ((), ())
    x = alt.X("x:Q").scale(domain=[0, len(columns)], nice=False, zero=False)
    y = alt.Y("y:Q").scale(domain=[0, len(lines)], nice=False, zero=False)
    # Least and largest sizes of a cell [pixels]: a letter fits in the first, words in the second.
    cell_width, cell_height = (13, 112), (13, 56)
    cell = _clip_value(room[0] / max(1, len(columns)), cell_width)
    width = cell * max(1, len(columns))
    height = _clip_value(room[1] / max(1, len(lines)), cell_height) * max(1, len(lines))
    # Tick labels below the map turn where a cell is too narrow.
    angle = -35 if max(map(len, columns), default=0) * 7 > cell else 0
    x = x.axis(title=axes.x.title if axes else "", **_cell_ticks(columns), labelAngle=angle)
    y_title = "" if axes is None else axes.y.title if axes.y else None
    y = y.axis(title=y_title, titlePadding=12, **_cell_ticks(lines))
    cells = layer_of("cells", rows.cells).mark_rect().encode(x, y, colour, x2="x2:Q", y2="y2:Q")
    bold = halo_layers(layer_of("texts", rows.texts), fontWeight="bold", fontSize=font_size)
    words = [layer.encode(x, y, text="text:N") for layer in bold]
    edge = layer_of("boundary", [*rows.boundary])
    edge = edge.mark_line(color=INK, strokeWidth=2.5, strokeDash=[6, 3])
    edge = edge.encode(x, y, order="order:Q", detail="part:N")
    focus = layer_of("ring", []).mark_rect(fill=None, stroke=INK, strokeWidth=3)
    paler: list[alt.Chart] = []
    if rows.inferred is not None:
        layer = layer_of("inferred", [*rows.inferred]).mark_rect(opacity=_LOOK.pale)
        paler = [layer.encode(x, y, colour.legend(None), x2="x2:Q", y2="y2:Q")]
    layers = (cells, *paler, *words, edge, focus.encode(x, y, x2="x2:Q", y2="y2:Q"))
    return alt.layer(*layers).properties(width=width, height=height)


def _cell_ticks(ticks: Sequence[str]) -> dict[str, Any]:
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
    report = compare_stores(baseline.address, store.address)
    policy, pairing = match_runs(baseline, store, DEFAULT_POLICY)
    option = "" if policy.match == "id" else " --match axes"
    return BaselineComparison(
        report=report,
        findings=tuple(
            check for outcome in _LISTED for check in report.findings if check.outcome == outcome
        ),
        maps=dict(_baseline_maps(data, baseline, pairing)),
        command=f"contactlab compare {shell_word(baseline.address)} "
        f"{shell_word(store.address)}{option}",
    )


def _baseline_maps(
    data: ReportData, baseline: Store, pairing: Pairing
) -> Iterator[tuple[str, Spec]]:
    """Yield maps of the labels, and of the error or the summary's first metric."""
    if data.map_axes is None:
        return
    before, after = pairing.baseline, pairing.candidate
    x, y = data.map_axes.x, data.map_axes.y
    axes = MapAxes(replace(x, codes=x.codes[after]), y and replace(y, codes=y.codes[after]))
    names = (*baseline.manifest.labels, *data.store.manifest.labels)
    old, new = _labels_of(baseline, names, before), _labels_of(data.store, names, after)
    # In the order of the names: labels are ordered worst first.
    moved = np.select([new.codes < old.codes, new.codes > old.codes], [0, 1], 2)
    change = replace(
        new,
        names=("worse", "better", "as before"),
        letters=("W", "B", ""),
        facts=tuple(map(_color_facts, (COLOURS[1], COLOURS[0], UNCHANGED_COLOUR))),
        codes=moved,
    )
    yield (
        "labels",
        _side_by_side([label_map(axes, labels, _LOOK.third) for labels in (old, new, change)]),
    )
    name = data.tradeoff.error.name if data.tradeoff else summary_metrics()[0]
    for quantity in data.quantities_named(name):
        for earlier in Quantities.of(baseline.columns).select_named([name]):
            old_values = replace(earlier, values=earlier.values[before])
            new_values = replace(quantity, values=quantity.values[after])
            values = [cell_statistic(axes, side, "worst") for side in (old_values, new_values)]
            title, resolution = f"worst {new_values.title}", new_values.column.resolution
            panels = [
                number_map(axes, own, title, resolution, _LOOK.third, other)
                for own, other in (values, values[::-1])
            ]
            with np.errstate(divide="ignore", invalid="ignore"):
                ratios = np.where(values[0] == values[1], 1.0, values[1] / values[0])
            ratios = np.where(np.isfinite(ratios) & (ratios > 0), ratios, np.nan)
            yield (
                name,
                _side_by_side([*panels, ratio_map(axes, ratios, new_values.title, _LOOK.third)]),
            )


def _labels_of(store: Store, names: Sequence[str], rows: NDArray[np.intp]) -> RunLabels:
    labels = read_run_labels(store, names)
    return replace(labels, codes=labels.codes[rows], masks=labels.masks[rows])


def _color_facts(colour: str) -> LabelFacts:
    return LabelFacts(colour=colour)


def _side_by_side(charts: Sequence[Layered]) -> Spec:
    titled = [chart.properties(title=title) for chart, title in zip(charts, _PANELS, strict=True)]
    joined = alt.hconcat(*titled, spacing=24).resolve_scale(color="independent")
    spec = joined.to_dict(validate=False)
    for place, part in enumerate(spec["hconcat"]):
        for layer in part["layer"]:
            layer["data"]["name"] += str(place)
    spec = apply_theme(spec)
    spec["config"]["legend"] |= {"orient": "bottom", "columns": 2}
    return spec
