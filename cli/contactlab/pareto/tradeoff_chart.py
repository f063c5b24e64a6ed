"""The chart of a trade-off as a Vega-Lite specification: log error over log time, by method."""

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import altair as alt

from contactlab.charts import halo_layers, layer_of
from contactlab.palette import COLOURS, INK, LETTERS, OTHERS_COLOUR, SHAPES
from contactlab.pareto.convergence import (
    TIMESTEP,
    MethodKey,
    method_key,
    method_name,
    swept_methods,
    varying_knobs,
)
from contactlab.pareto.recommendation import SAFE_MARGIN, front_of
from contactlab.schema.tradeoff_report import Configuration, Settings, TradeoffReport

OTHERS = "others"
_INTEGRATOR = "integrator"
RECOMMENDED = "recommended"
ROBUST = f"margins >= {SAFE_MARGIN:g}"
NOW = "now"
_MOST_METHODS = 4  # more colors and shapes are hard to distinguish
_SIZE = (640, 440)  # of the chart [pixels]


# A run labeled oracle_miss has a large error, which the chart shows.
_MEASURED_LABELS = {"stable", "oracle_miss"}
Row = dict[str, Any]


class ChartFrame(NamedTuple):
    """The limits of the axes: time [CPU s per simulated s], and error in its unit, never 0."""

    time: tuple[float, float]
    error: tuple[float, float]


@dataclass(frozen=True)
class ChartData:
    """The rows of the figure's layers."""

    frame: ChartFrame
    methods: list[str]  # names of the methods with a color, with their letters; the best first
    points: list[
        Row
    ]  # one per configuration, of insensitive knobs with the recommendation's value alone
    front: list[Row]  # the feasible Pareto front, cheapest first
    floors: list[Row]  # one per colored method with a floor


def chart_data(report: TradeoffReport, places: Collection[int] | None = None) -> ChartData:
    """Return the rows of every layer of a report's chart, or only of some places.

    At most four methods get a colour: the recommended first, then that of the model as written,
    those on the front, then the most accurate. With more methods, each integrator has a color, and
    its line is its own front.
    """
    keys = {method_key(method.configuration) for method in report.methods}
    drawn_configurations = {
        place: configuration
        for place, configuration in enumerate(report.configurations)
        if (method_key(configuration.configuration) in keys or configuration == report.baseline)
        and (places is None or place in places)
    }
    crowded = len(keys) > _MOST_METHODS and _INTEGRATOR in report.varying
    lines = {
        place: _line_key(configuration.configuration, crowded=crowded)
        for place, configuration in drawn_configurations.items()
    }
    front = _front_places(
        {
            place: configuration
            for place, configuration in drawn_configurations.items()
            if configuration.feasible
        }
    )
    names = _method_names(report, drawn_configurations, lines, front)
    floors: list[Row] = [
        {"method": names[key], "error": method.floor.error}
        for method in report.methods
        if method.floor and (key := _line_key(method.configuration, crowded=crowded)) in names
    ]
    frame = _axis_limits(
        report, drawn_configurations.values(), [floor["error"] for floor in floors]
    )
    drawn_lines = {
        place: key for place, key in lines.items() if not _is_failed(drawn_configurations[place])
    }
    if crowded:
        fronts = [
            _front_places(
                {
                    place: drawn_configurations[place]
                    for place in drawn_lines
                    if drawn_lines[place] == key
                }
            )
            for key in dict.fromkeys(drawn_lines.values())
        ]
        drawn_lines = {place: drawn_lines[place] for members in fronts for place in members}
    return ChartData(
        frame=frame,
        methods=list(names.values()),
        points=[
            {
                **_point_row(configuration, report, names.get(lines[place], OTHERS), frame),
                "place": place,
                "line": str(lines[place]),
                "drawn": place in drawn_lines,
                "labelled": place in front,
            }
            for place, configuration in drawn_configurations.items()
        ],
        front=[
            {
                "time": drawn_configurations[place].time,
                "error": _visible_error(drawn_configurations[place].error, frame),
            }
            for place in front
        ],
        floors=floors,
    )


def _is_failed(configuration: Configuration) -> bool:
    """Return whether a configuration has no place on the axis of errors."""
    return configuration.error is None or not set(configuration.outcomes.labels) <= _MEASURED_LABELS


def _line_key(values: Settings, *, crowded: bool) -> MethodKey:
    """Return the shared key of the points of one line: the method, or the integrator."""
    return ((_INTEGRATOR, values[_INTEGRATOR]),) if crowded else method_key(values)


def _front_places(configurations: Mapping[int, Configuration]) -> list[int]:
    places = list(configurations)
    return [places[index] for index in front_of([*configurations.values()])]


def _method_names(
    report: TradeoffReport,
    configurations: Mapping[int, Configuration],
    lines: Mapping[int, MethodKey],
    front: Collection[int],
) -> dict[MethodKey, str]:
    marked = [
        place
        for place in configurations
        if _mark_words(configurations[place].configuration, report)
    ]
    marked.sort(key=lambda place: _mark_words(configurations[place].configuration, report) == NOW)
    measured_places = [place for place in configurations if not _is_failed(configurations[place])]
    by_error = sorted(measured_places, key=lambda place: configurations[place].error or 0.0)
    keys = list(
        dict.fromkeys(lines[place] for place in (*marked, *front, *by_error, *configurations))
    )
    differing = varying_knobs([dict(key) for key in keys]) or swept_methods(report.varying)
    return {
        key: f"{letter}  {method_name(dict(key), differing, report.units)}"
        for letter, key in zip(LETTERS[:_MOST_METHODS], keys, strict=False)
    }


def _axis_limits(
    report: TradeoffReport, configurations: Collection[Configuration], floors: list[float]
) -> ChartFrame:
    limit = report.tolerances.get(report.error.name)
    times = [configuration.time for configuration in configurations if configuration.time]
    errors = [
        configuration.error
        for configuration in configurations
        if configuration.error and not _is_failed(configuration)
    ]
    # Errors above this many tolerances are drawn at the edge, to leave room for the others.
    most_tolerances = 30.0
    near = [error for error in errors if not limit or error <= most_tolerances * limit]
    return ChartFrame(
        _padded_range(times), _padded_range([*near, *floors, *([limit] if limit else [])])
    )


def _padded_range(values: list[float]) -> tuple[float, float]:
    padding = 1.6  # factor of the extent of axes beyond the outermost points
    return min(values, default=1.0) / padding, max(values, default=1.0) * padding


def _point_row(
    configuration: Configuration, report: TradeoffReport, name: str, frame: ChartFrame
) -> Row:
    failed = _is_failed(configuration) or (configuration.error or 0.0) > frame.error[1]
    step = configuration.configuration.get(TIMESTEP)
    label = f"{1e3 * step:.3g} ms" if isinstance(step, int | float) else ""
    chosen = _mark_words(configuration.configuration, report)
    return {
        "method": name,
        "time": configuration.time or frame.time[0],
        "error": frame.error[1] if failed else _visible_error(configuration.error, frame),
        "timestep": step,
        "bound": configuration.below_estimate,
        "least": configuration.error_spread
        and _visible_error(configuration.error_spread[0], frame),
        "label": f"{name[:1]} {label}",
        "state": "failed"
        if failed
        else f"{'within' if configuration.feasible else 'beyond'} tolerance",
        "chosen": f"{chosen} {name[:1]} {label}".strip() if chosen else "",
    }


def _visible_error(error: float | None, frame: ChartFrame) -> float:
    """Return an error that a logarithmic axis can show: at least the lower limit."""
    return max(error or 0.0, frame.error[0])


def _mark_words(values: Settings, report: TradeoffReport) -> str:
    """Return the words at the model as written and at recommended ones; empty at others."""
    words = [NOW] if report.baseline and report.baseline.configuration == values else []
    knobs = [name for name in report.knobs if name not in report.insensitive_knobs]
    for word, pick in ((RECOMMENDED, report.recommendation), (ROBUST, report.robust)):
        if pick and all(pick.configuration[name] == values[name] for name in knobs):
            words.append(word)
            break
    return ", ".join(words)


# Text of a tick: a fraction while that is short; most labels of a logarithmic axis are empty.
_TICK_LABEL = "datum.label && format(datum.value, datum.value < 1e-3 ? '~e' : '~g')"
_POINT_STATES = ("within tolerance", "beyond tolerance", "failed")
_Channel = TypeVar("_Channel", alt.Color, alt.Shape)


def chart_specification(
    report: TradeoffReport, places: Collection[int] | None = None
) -> alt.TopLevelMixin:
    """Return the chart of a report, or of the configurations at some places of it.

    Its data are named `lines`, `points`, `failures`, `front`, `chosen`, ...; rows of points have
    the place of their configuration in the report.
    """
    feasible = sum(configuration.feasible for configuration in report.configurations)
    feasible_text = f"{feasible} of {len(report.configurations)}"
    title = alt.TitleParams(
        f"{report.scene}: what accuracy costs in time",
        subtitle=[
            f"{feasible_text} configurations are feasible; gray line: their Pareto front;",
            "filled: within every tolerance; hollow: beyond one; cross: failed, or off the chart;",
            "arrow: upper bound; dotted: modeling error; bar: down to the least of its runs",
        ],
        fontSize=15,
    )
    return (
        alt.layer(*_chart_layers(report, chart_data(report, places)))
        .properties(width=_SIZE[0], height=_SIZE[1], title=title)
        .configure_axis(tickCount=6)
        .configure_legend(symbolSize=90, titleFontSize=12, labelFontSize=11)
    )


def _chart_layers(report: TradeoffReport, data: ChartData) -> Iterator[alt.Chart]:
    source = "" if report.time.source == "timing" else " (while recording)"
    x = alt.X("time:Q").scale(type="log", domain=data.frame.time, nice=False)
    y = alt.Y("error:Q").scale(type="log", domain=data.frame.error, nice=False)
    x = x.axis(title=f"CPU seconds per simulated second{source}", format="~g")
    y = y.axis(title=_error_title(report), labelExpr=_TICK_LABEL)
    colour = _method_channel(data, alt.Color, [*COLOURS[: len(data.methods)], OTHERS_COLOUR])
    measured_points = [point for point in data.points if point["state"] != "failed"]
    failed = [point for point in data.points if point["state"] == "failed"]
    named_points = [point for point in measured_points if point["method"] != OTHERS]
    if limit := report.tolerances.get(report.error.name):
        low = alt.Y("low:Q").scale(type="log", domain=data.frame.error, nice=False)
        across = alt.X("time:Q").scale(type="log", domain=data.frame.time, nice=False)
        band = layer_of("band", [{"low": limit, "high": data.frame.error[1]}])
        yield band.mark_rect(color="#f2f2f2").encode(low, alt.Y2("high:Q"))
        words = layer_of(
            "tolerance", [{"low": limit, "text": "tolerance", "time": data.frame.time[1]}]
        )
        label_text = words.mark_text(align="right", dx=-4, dy=-7, color="#777777", fontSize=11)
        yield label_text.encode(across, low, alt.Text("text:N"))
    line_points = [point for point in measured_points if point["drawn"]]
    lines = layer_of("lines", line_points).mark_line(strokeWidth=1.2, opacity=0.8)
    yield lines.encode(x, y, colour, detail="line:N", order="time:Q")
    if data.floors:
        rules = layer_of("floors", data.floors).mark_rule(strokeDash=[2, 3], strokeWidth=1.5)
        yield rules.encode(y, colour)
    # A staircase: between two points of the front, only the cheaper one is attainable.
    stairs = layer_of("front", data.front).mark_line(
        strokeWidth=4, color=INK, opacity=0.35, interpolate="step-after"
    )
    yield stairs.encode(x, y, order="time:Q")
    rings = _place_ring_names(data)
    yield from _timestep_labels(data, named_points, rings, x, y)
    named_lines = [point for point in named_points if point["drawn"] and point["least"]]
    bars = layer_of("spreads", named_lines)
    yield bars.mark_rule(opacity=0.5).encode(x, y, alt.Y2("least:Q"), colour)
    count = len(data.methods)
    shape = _method_channel(data, alt.Shape, [*SHAPES[:count], "stroke"])
    fill = alt.Fill("method:N").scale(domain=data.methods, range=COLOURS[:count]).legend(None)
    opacity = alt.FillOpacity("state:O").scale(domain=_POINT_STATES[:2], range=[1, 0]).legend(None)
    for name, size, strength in (("beside", 24, 0.5), ("points", 70, 1.0)):
        points = layer_of(
            name, [point for point in named_points if point["drawn"] == (name == "points")]
        )
        marked = points.mark_point(size=size, strokeWidth=1.5, opacity=strength)
        yield marked.encode(x, y, colour, shape, fill, opacity)
    crosses = layer_of("failures", failed).mark_text(text="\u2715", size=13, dy=8)
    yield crosses.encode(x, y, colour)
    # Upper bounds: errors below the uncertainty of their reference.
    arrows = layer_of("bounds", [point for point in measured_points if point["bound"]]).mark_point(
        shape="arrow", angle=180, size=260, yOffset=14, color=INK
    )
    yield arrows.encode(x, y)
    ring = layer_of("chosen", rings)
    circles = ring.mark_point(shape="circle", size=420, strokeWidth=2.2, color=INK, opacity=1)
    yield circles.encode(x, y)
    placed = {name: alt.ExprRef(f"datum.{name}") for name in ("align", "dx", "dy")}
    bold = {"fontSize": 12, "fontWeight": "bold"}
    for mark in halo_layers(ring, **placed, **bold):
        yield mark.encode(x, y, text="chosen:N")


def _error_title(report: TradeoffReport) -> str:
    unit = f" [{report.error.unit}]" if report.error.unit not in {"", "1", "any"} else ""
    runs, most_names = report.runs_per_configuration, 2
    title = f"{report.error.name}{unit}, worst of {runs} run{'s' * (runs != 1)}"
    if runs == 1 or not report.scenarios:
        return title
    more = len(report.scenarios) - most_names
    names = ", ".join(report.scenarios[:most_names])
    return f"{title} over {names}{f' and {more} more' if more > 0 else ''}"


def _method_channel(data: ChartData, channel: type[_Channel], values: list[str]) -> _Channel:
    names = [*data.methods, OTHERS]
    used_methods = [name for name in names if any(point["method"] == name for point in data.points)]
    scaled = channel("method:N").scale(domain=names, range=values)
    return scaled.legend(title="method", values=used_methods)


class _Box(NamedTuple):
    """Sides of a rectangle of the chart [pixels]."""

    left: float
    right: float
    top: float
    bottom: float

    def overlaps_box(self, other: "_Box") -> bool:
        return (
            self.left < other.right
            and other.left < self.right
            and self.top < other.bottom
            and other.top < self.bottom
        )


def _box_of(
    row: Row, frame: ChartFrame, text: str = "", place: Row | None = None, *, size: int = 11
) -> _Box:
    # Without a place, the box of the point itself.
    width, height = _SIZE
    (fastest, slowest), (least, most) = frame
    x = width * math.log(row["time"] / fastest) / math.log(slowest / fastest)
    y = height * math.log(most / row["error"]) / math.log(most / least)
    if place is None:
        return _Box(x - 6, x + 6, y - 6, y + 6)
    # A letter is about .6 of its font's size wide.
    begin, length = x + place["dx"], 0.6 * size * len(text)
    left_edge = begin - length if place["align"] == "right" else begin
    middle = y + place["dy"]
    return _Box(left_edge, left_edge + length, middle - size / 2, middle + size / 2)


def _list_places(dx: int, *dys: int) -> list[Row]:
    return [
        {"align": align, "dx": across, "dy": dy}
        for dy in dys
        for align, across in (("left", dx), ("right", -dx))
    ]


def _least_covering(
    row: Row, frame: ChartFrame, text: str, places: list[Row], occupied: list[_Box], *, size: int
) -> tuple[float, Row, _Box]:
    # How many boxes the best place of a text covers, the first such place, and its box.
    outside = 100  # boxes that are as bad as a text that is cut off
    found = list[tuple[float, Row, _Box]]()
    for place in places:
        box = _box_of(row, frame, text, place, size=size)
        is_cut = box.left < 0 or box.right > _SIZE[0] or box.top < 0 or box.bottom > _SIZE[1]
        covered = sum(box.overlaps_box(other) for other in occupied)
        found.append((outside * is_cut + covered, place, box))
    return min(found, key=lambda each: each[0])


def _place_ring_names(data: ChartData) -> list[Row]:
    rows: list[Row] = []
    occupied = [_box_of(point, data.frame) for point in data.points]
    for point in data.points:
        if not point["chosen"]:
            continue
        places = _list_places(12, -16, 18)
        _, place, box = _least_covering(
            point, data.frame, point["chosen"], places, occupied, size=12
        )
        occupied.append(box)
        rows.append(point | place)
    return rows


def _timestep_labels(
    data: ChartData, named_points: list[Row], rings: list[Row], x: alt.X, y: alt.Y
) -> Iterator[alt.Chart]:
    # Labels cover neither points, nor each other, nor names of rings; a label without room is left
    # out, since the list below the chart has all points.
    keys = ("align", "dx", "dy")
    occupied = [
        *(_box_of(point, data.frame) for point in data.points),
        *(
            _box_of(ring, data.frame, ring["chosen"], {key: ring[key] for key in keys}, size=12)
            for ring in rings
        ),
    ]
    rows: list[Row] = []
    for point in named_points:
        if not point["labelled"] or point["chosen"]:
            continue
        covered, place, box = _least_covering(
            point, data.frame, point["label"], _list_places(8, -9, 11), occupied, size=10
        )
        if covered:
            continue
        occupied.append(box)
        rows.append(point | place)
    placed = {name: alt.ExprRef(f"datum.{name}") for name in keys}
    for mark in halo_layers(layer_of("labels", rows), **placed, fontSize=10):
        yield mark.encode(x, y, text="label:N")
