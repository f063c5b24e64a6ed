"""Chart of the front: error over time of its named points, with the ladder of each integrator."""

import itertools
import math
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import altair as alt

from contactlab.charts import Rows, halo_layers, layer_of, word_colours
from contactlab.palette import COLOURS, INK
from contactlab.rendering.amounts import format_amount, format_percent
from contactlab.schema.tune_report import Candidate, FrontPoint, TuneReport
from contactlab.studies.search.configuration import INTEGRATOR, format_settings
from contactlab.studies.search.report_text import error_text

_FAINT, _EDGE = "#555555", "#999999"
Channel = TypeVar("Channel", alt.X, alt.Y)
Box = tuple[float, float, float, float]
"""Left, top, right and bottom of a text [px]."""


@dataclass(frozen=True)
class FrontLayout:
    """Size of the chart, and of the room that a name takes [px].

    Attributes:
        width, height: of the plot.
        letter, line: of a letter and of a line of names.
        font: size of names.
        titled: whether the chart names the model itself; a page does that in its head.
    """

    width: int = 560
    height: int = 340
    letter: float = 6.2
    line: float = 13.0
    font: int = 11
    titled: bool = True


PAGE_LAYOUTS = {
    "wide": FrontLayout(width=960, height=440, titled=False),
    "narrow": FrontLayout(width=290, height=320, letter=5.8, line=12.0, font=10, titled=False),
}
"""For a page: in a wide window, and on a telephone."""


@dataclass(frozen=True)
class Scale:
    """A logarithmic axis: from the least to the largest value, on a length [px]."""

    low: float
    high: float
    length: float

    def locate_value(self, value: float) -> float:
        """Return the distance of a value from the low end [px]."""
        span = math.log(self.high / self.low)
        return self.length * math.log(max(value, 1e-300) / self.low) / span

    def has_value(self, value: float) -> bool:
        """Return whether a value lies on the axis."""
        return self.low <= value <= self.high

    def list_ticks(self) -> list[float]:
        """Return 1, 2 and 5 times powers of ten; of many powers, these alone or every second."""
        powers = range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1)
        digits = (1, 2, 5) if len(powers) < 5 else (1,)
        powers = [power for power in powers if power % (1 + len(powers) // 9) == 0]
        candidates = [float(f"{digit}e{power}") for power in powers for digit in digits]
        return [tick for tick in candidates if self.has_value(tick)]


def draw_front(report: TuneReport, layout: FrontLayout | None = None) -> alt.TopLevelMixin:
    """Return the chart of a front.

    The axes span its points. Dots and lines are all measured candidates of an integrator that no
    other one of it beats.
    """
    layout = layout or FrontLayout()
    points = [point for point in report.front if point.error is not None]
    times = [_time_of(point) for point in points]
    errors = [_error_of(point) for point in points]
    across = Scale(min(times) / 1.25, max(times) * 1.25, layout.width)
    # A low end that is nearly 0 does not stretch the axis.
    lows = [max(_low_of(point), _error_of(point) / 3) for point in points]
    highs = [point.error_high or _error_of(point) for point in points]
    top = max([*errors, *highs, *_limits_near(report, errors)])
    low = min([*errors, *lows])
    room = 1.2 * (top / low) ** 0.06  # at both ends, for names
    upward = Scale(low / room, room * top, layout.height)
    x = _scale_axis(
        alt.X("time:Q"), across, "time of a simulated second, over that as written", "x"
    )
    y = _scale_axis(alt.Y("error:Q"), upward, _error_title(report), report.target.unit)
    levels, ladders = _find_levels(report, upward), _ladder_rows(report, points)
    curves = [*_ladder_boxes(ladders, across, upward), *_span_boxes(points, across, upward)]
    boxes = _place_levels(levels, curves, upward, layout)
    lines = [*_level_lines(levels, upward, layout), *curves]
    rows_drawn = [
        row for row in ladders if across.has_value(row["time"]) and upward.has_value(row["error"])
    ]
    colours = _integrator_colours({row["integrator"] for row in rows_drawn})
    colour = word_colours("integrator", list(colours), list(colours.values())).title(None)
    point_layer = layer_of(
        "points", [_point_row(point, report, upward.low) for point in points]
    ).encode(x=x, y=y, color=colour)
    ladder = layer_of("ladders", [row for row in ladders if row["integrator"] in colours]).encode(
        x=x, y=y, color=colour
    )
    layers = [
        *_level_layers(levels, boxes, layout, y),
        ladder.mark_line(opacity=0.35, strokeWidth=1.2, clip=True),
        ladder.mark_point(filled=True, size=14, opacity=0.45, clip=True),
        point_layer.mark_rule(opacity=0.55, clip=True).encode(y=alt.Y("low:Q"), y2="high:Q"),
        point_layer.mark_rule(opacity=0.55, clip=True).encode(x=alt.X("fast:Q"), x2="slow:Q"),
        point_layer.mark_point(filled=True, size=80, opacity=1),
        *_ring_layers(points, report, x, y),
        *_name_layers(points, across, upward, layout, (boxes, lines), x, y),
    ]
    title = alt.TitleParams(
        [entitle_front(report)] if layout.titled else [],
        subtitle=_write_subtitle(report),
        fontSize=13,
        subtitleFontSize=11,
    )
    return (
        alt.layer(*layers)
        .properties(width=layout.width, height=layout.height, title=title)
        .configure_legend(orient="bottom", symbolType="circle", symbolOpacity=1)
    )


def entitle_front(report: TuneReport) -> str:
    """Return the title of a figure or a page."""
    return f"{Path(report.model).name}: what accuracy costs"


def _error_of(point: FrontPoint) -> float:
    return max(point.error or 0.0, 1e-16)  # the axis is logarithmic


def _low_of(point: FrontPoint) -> float:
    # The error of one seed has no interval.
    return _error_of(point) if point.error_low is None else point.error_low


def _time_of(point: FrontPoint) -> float:
    if "as written" in point.marks:
        return 1.0
    candidate = point.candidate
    return candidate.time_ratio.ratio if candidate.time_ratio else candidate.cost or 1.0


def _limits_near(report: TuneReport, errors: Sequence[float]) -> Iterator[float]:
    # A tolerance far above all points would leave most of the chart empty.
    limit, largest = report.target.tolerance, max(errors)
    if report.target.unit == "1" and limit < 5 * largest:
        yield limit


def _scale_axis(channel: Channel, scale: Scale, title: str, unit: str) -> Channel:
    ticks = scale.list_ticks()
    label = "format(datum.value, '~g')"
    if unit == "x":
        label = f"'x' + {label}"
    elif unit == "1":
        label = f"'{format_percent(ticks[-1])}'" if ticks else "''"
        for tick in reversed(ticks[:-1]):
            label = f"datum.value < {1.5 * tick:g} ? '{format_percent(tick)}' : {label}"
    axis = alt.Axis(values=ticks, labelExpr=label, labelOverlap=True)
    domain = alt.Scale(type="log", domain=[scale.low, scale.high], nice=False)
    return channel.title(title).scale(domain).axis(axis)


def _error_title(report: TuneReport) -> str:
    unit = report.target.unit
    return "numerical error, share of the real forces" if unit == "1" else f"forward error [{unit}]"


def _write_subtitle(report: TuneReport) -> str:
    if report.target.unit != "1":
        return f"error at the {report.target.error_at} of {', '.join(report.target.observed)}"
    real_time = format_amount(report.real_time, digits=2)
    return f"95 % interval over any seeds; as written {real_time}x real time"


def _integrator_of(candidate: Candidate, report: TuneReport) -> str:
    return str(candidate.settings.get(INTEGRATOR, report.integrator))


def _integrator_colours(names: Container[str]) -> Mapping[str, str]:
    order = ("RK4", "implicitfast", "Euler", "implicit")
    chosen = (COLOURS[0], COLOURS[1], COLOURS[3], COLOURS[4])
    return {name: colour for name, colour in zip(order, chosen, strict=True) if name in names}


def _point_row(point: FrontPoint, report: TuneReport, least: float = 0.0) -> dict[str, object]:
    candidate, time = point.candidate, _time_of(point)
    ratio = None if "as written" in point.marks else candidate.time_ratio
    return {
        "name": f"{point.number} {point.name}",
        "time": time,
        "fast": ratio.low if ratio else time,
        "slow": ratio.high if ratio else time,
        "error": _error_of(point),
        "low": max(least, _low_of(point)),
        "high": point.error_high or _error_of(point),
        "integrator": _integrator_of(candidate, report),
    }


def _ladder_rows(report: TuneReport, points: Sequence[FrontPoint]) -> Rows:
    # Points, and the candidates of an integrator that no other one of it beats.
    #
    # Points are measured more closely than candidates: those that contradict a point are left out.
    own = [_point_row(point, report) for point in points]
    names = {_name_settings(point.candidate) for point in points}
    rows: Rows = [
        {"time": each.cost, "error": each.error, "integrator": _integrator_of(each, report)}
        for each in report.candidates
        if each.error and each.cost and _name_settings(each) not in names
    ]
    rows = [row for row in rows if not any(_contradicts_point(row, other) for other in own)]
    rows = [row for row in rows if not any(_beats_row(other, row) for other in rows)]
    return sorted([*rows, *own], key=lambda row: (row["integrator"], row["time"]))


def _name_settings(candidate: Candidate) -> tuple[float, str]:
    return candidate.timestep, format_settings(candidate.settings)


def _beats_row(row: dict[str, Any], other: dict[str, Any]) -> bool:
    return (
        row is not other
        and row["integrator"] == other["integrator"]
        and row["time"] <= other["time"]
        and row["error"] <= other["error"]
    )


def _contradicts_point(row: dict[str, Any], point: dict[str, Any]) -> bool:
    # A point is beaten by no candidate, and beats some of its own integrator.
    return _beats_row(row | {"integrator": point["integrator"]}, point) or _beats_row(point, row)


def _find_levels(report: TuneReport, upward: Scale) -> Rows:
    unit = report.target.unit
    levels: Rows = []
    if unit == "1":
        text = f"tolerance {format_percent(report.target.tolerance)}"
        levels.append({"error": report.target.tolerance, "text": text})
    if report.target.kind in ("error", "forward error"):
        text = f"requested {error_text(report.target.limit, unit)}"
        levels.append({"error": report.target.limit, "text": text})
    for each in report.uncertainty:
        parameter, _, share = each.name.partition(" ")
        text = f"{parameter} known to {share}: {format_percent(each.error)}"
        levels.append({"error": each.error, "text": text})
    levels = [row for row in levels if row["error"] and upward.low < row["error"] < upward.high]
    levels.sort(key=lambda row: -row["error"])
    return levels


def _level_layers(
    levels: Rows, boxes: Sequence[Box], layout: FrontLayout, y: alt.Y
) -> Iterator[alt.Chart]:
    for row, box in zip(levels, boxes, strict=True):
        line, is_left = layer_of(row["text"], [row]).encode(y=y), box[0] <= 0
        yield line.mark_rule(color=_EDGE, strokeDash=[5, 4])
        yield from halo_layers(
            line.encode(x=alt.value(0 if is_left else "width"), y=alt.value(box[1]), text="text:N"),
            align="left" if is_left else "right",
            baseline="top",
            dx=4 if is_left else -4,
            fontSize=layout.font - 1,
            color=_FAINT,
        )


def _place_levels(
    levels: Rows, curves: Sequence[Box], upward: Scale, layout: FrontLayout
) -> list[Box]:
    # Boxes of texts: at the end of their line that is free, above it if there is room.
    spots_taken, lines = list[Box](), [*_level_lines(levels, upward, layout)]
    for row, line in zip(levels, lines, strict=True):
        room = layout.letter * len(row["text"])
        others = [*curves, *(other for other in lines if other != line)]
        spots = [
            (left, top, left + room, top + layout.line)
            for top in (line[1] - layout.line, line[3] + 1)
            for left in (layout.width - room, 0.0)
        ]
        spots_taken.append(
            min(
                spots,
                key=lambda spot: (
                    sum(_overlap_area(spot, other) for other in others)
                    + 5 * sum(_overlap_area(spot, other) for other in spots_taken)
                    + _outside_penalty(spot, layout)
                ),
            )
        )
    return spots_taken


def _level_lines(levels: Rows, upward: Scale, layout: FrontLayout) -> Iterator[Box]:
    for row in levels:
        top = upward.length - upward.locate_value(row["error"])
        yield 0.0, top - 2, float(layout.width), top + 2


def _ladder_boxes(ladders: Rows, across: Scale, upward: Scale) -> Iterator[Box]:
    # Lines that no text should cross, as small boxes along them.
    for one, other in itertools.pairwise(ladders):
        if one["integrator"] != other["integrator"]:
            continue
        begin, end = (
            (across.locate_value(row["time"]), upward.length - upward.locate_value(row["error"]))
            for row in (one, other)
        )
        count = 1 + int(math.dist(begin, end) / 6)
        for place in range(count + 1):
            left, top = (a + (b - a) * place / count for a, b in zip(begin, end, strict=True))
            yield left - 2, top - 2, left + 2, top + 2


def _span_boxes(points: Sequence[FrontPoint], across: Scale, upward: Scale) -> Iterator[Box]:
    for point in points:
        left = across.locate_value(_time_of(point))
        low, high = (
            upward.length - upward.locate_value(max(value, upward.low))
            for value in (_low_of(point), point.error_high or _error_of(point))
        )
        yield left - 2, high, left + 2, low


def _ring_layers(
    points: Sequence[FrontPoint], report: TuneReport, x: alt.X, y: alt.Y
) -> Iterator[alt.Chart]:
    # Dashed as written, closed if recommended.
    for mark, dash in (("as written", [2, 2]), ("recommended", [1, 0])):
        rows = [_point_row(point, report) for point in points if mark in point.marks]
        if rows:
            ring = layer_of(mark, rows).encode(x=x, y=y)
            yield ring.mark_point(
                filled=False, shape="circle", size=260, color=INK, strokeWidth=1.4, strokeDash=dash
            )


def _name_layers(
    points: Sequence[FrontPoint],
    across: Scale,
    upward: Scale,
    layout: FrontLayout,
    occupied: tuple[Sequence[Box], Sequence[Box]],
    x: alt.X,
    y: alt.Y,
) -> Iterator[alt.Chart]:
    # Each at the nearest free place around its point; lines count less than texts and points.
    texts, lines = occupied
    places = [
        (
            across.locate_value(_time_of(point)),
            layout.height - upward.locate_value(_error_of(point)),
        )
        for point in points
    ]
    occupied_boxes = [*texts, *((left - 6, top - 6, left + 6, top + 6) for left, top in places)]
    # Marked points come first: they are near each other.
    order = sorted(range(len(points)), key=lambda place: not points[place].marks)
    for place in order:
        point, (left, top) = points[place], places[place]
        # On a telephone, rings and bold words alone show the marks.
        marks = point.marks if layout.titled or layout.width > layout.height else ()
        text = f"{point.number} {', '.join((point.name, *marks))}"
        is_bold = "recommended" in point.marks
        room = layout.letter * len(text) * (1.1 if is_bold else 1.0)
        spots = _spots_around(left, top, room, layout)
        align, dy, box = min(
            spots,
            key=lambda spot: (
                sum(_overlap_area(spot[2], other) for other in occupied_boxes)
                + 0.5 * sum(_overlap_area(spot[2], other) for other in lines)
                + _outside_penalty(spot[2], layout)
                + layout.line / 2 * abs(spot[1])
            ),
        )
        occupied_boxes.append(box)
        shift = {"left": 11, "right": -11, "center": 0}[align]
        row = {"time": _time_of(point), "error": _error_of(point), "name": text}
        words = layer_of(f"name {place}", [row]).encode(x=x, y=y, text="name:N")
        yield from halo_layers(
            words,
            align=align,
            baseline="middle",
            dx=shift,
            dy=dy,
            fontSize=layout.font,
            fontWeight="bold" if is_bold else "normal",
        )


def _spots_around(
    left: float, top: float, room: float, layout: FrontLayout
) -> Iterator[tuple[str, float, Box]]:
    half = layout.line / 2
    for shift in (-8.0, 9.0, -20.0, 21.0, -33.0, 34.0):
        for align in ("left", "right", "center"):
            begin = {"left": left + 11, "right": left - 11 - room, "center": left - room / 2}[align]
            yield align, shift, (begin, top + shift - half, begin + room, top + shift + half)


def _overlap_area(one: Box, other: Box) -> float:
    wide = min(one[2], other[2]) - max(one[0], other[0])
    high = min(one[3], other[3]) - max(one[1], other[1])
    return wide * high if wide > 0 and high > 0 else 0.0


def _outside_penalty(box: Box, layout: FrontLayout) -> float:
    left, top, right, bottom = box
    over = max(0.0, -left) + max(0.0, right - layout.width)
    return 20 * (over + max(0.0, -top) + max(0.0, bottom - layout.height))
