"""The chart as a Vega-Lite specification: log error over log time, one line per method."""

import math
from collections.abc import Iterator
from typing import Any, TypeVar

import altair as alt

from contactlab.palette import COLOURS, INK, OTHERS_COLOUR, SHAPES
from contactlab.pareto.chart_data import OTHERS, ChartData, chart_data
from contactlab.schema.tradeoff_report import TradeoffReport

_SIZE = (640, 440)
# As a fraction while that is short; most labels of a logarithmic axis are left empty.
_SHORT = "datum.label && format(datum.value, datum.value < 1e-3 ? '~e' : '~g')"
_STATES = ("within tolerance", "beyond tolerance", "failed")
# More labels than this hide the points; then only the front and the ends of lines have theirs.
_MOST_LABELS = 24
_Channel = TypeVar("_Channel", alt.Color, alt.Shape)


def specification(report: TradeoffReport) -> alt.TopLevelMixin:
    """Return the chart of a report."""
    shown = chart_data(report)
    layers = [*_layers(report, shown)]
    return (
        alt.layer(*layers)
        .properties(width=_SIZE[0], height=_SIZE[1], title=_title(report))
        .configure(background="white", font="sans-serif")
        .configure_view(stroke="#999999")
        .configure_axis(gridColor="#eeeeee", labelFontSize=11, titleFontSize=12, tickCount=6)
        .configure_legend(labelLimit=360, symbolSize=90, titleFontSize=12, labelFontSize=11)
    )


def _layers(report: TradeoffReport, shown: ChartData) -> Iterator[alt.Chart]:
    limit = report.tolerances.get(report.error.name)
    if limit:
        yield from _tolerance(shown, limit)
    x, y = _axes(report, shown)
    colour = _coloured(shown, alt.Color, [*COLOURS[: len(shown.methods)], OTHERS_COLOUR])
    yield _lines(shown, x, y, colour)
    if shown.floors:
        yield _floors(shown, y, colour)
    yield _front(shown, x, y)
    yield from _labels(shown, x, y)
    yield _points(shown, x, y, colour)
    yield _failures(shown, x, y, colour)
    yield _bounds(shown, x, y)
    yield from _chosen(shown, x, y)


def _axes(report: TradeoffReport, shown: ChartData) -> tuple[alt.X, alt.Y]:
    unit = f" [{report.error.unit}]" if report.error.unit not in {"", "1", "any"} else ""
    source = "" if report.time.source == "timing" else " (while recording)"
    x = alt.X("time:Q").scale(type="log", domain=shown.frame.time, nice=False)
    y = alt.Y("error:Q").scale(type="log", domain=shown.frame.error, nice=False)
    return (
        x.axis(title=f"CPU seconds per simulated second{source}", format="~g"),
        y.axis(title=f"{report.error.name}{unit}, worst of {report.cases} runs", labelExpr=_SHORT),
    )


def _coloured(shown: ChartData, channel: type[_Channel], values: list[str]) -> _Channel:
    """Return a channel that tells methods apart, with a legend of those that occur."""
    names = [*shown.methods, OTHERS]
    used = [name for name in names if any(each["method"] == name for each in shown.points)]
    scaled = channel("method:N").scale(domain=names, range=values)
    return scaled.legend(title="method", values=used)


def _lines(shown: ChartData, x: alt.X, y: alt.Y, colour: alt.Color) -> alt.Chart:
    rows = [each for each in shown.points if each["state"] != "failed"]
    return (
        _chart("lines", rows)
        .mark_line(strokeWidth=1.2, opacity=0.8)
        .encode(x, y, colour, detail="line:N", order="timestep:Q")
    )


def _points(shown: ChartData, x: alt.X, y: alt.Y, colour: alt.Color) -> alt.Chart:
    rows = [each for each in shown.points if each["state"] != "failed" and each["method"] != OTHERS]
    shape = _coloured(shown, alt.Shape, [*SHAPES[: len(shown.methods)], "stroke"])
    fill = alt.Fill("method:N").scale(domain=shown.methods, range=COLOURS[: len(shown.methods)])
    opacity = alt.FillOpacity("state:O").scale(domain=_STATES[:2], range=[1, 0]).legend(None)
    return (
        _chart("points", rows)
        .mark_point(size=70, strokeWidth=1.5, opacity=1)
        .encode(x, y, colour, shape, fill.legend(None), opacity)
    )


def _failures(shown: ChartData, x: alt.X, y: alt.Y, colour: alt.Color) -> alt.Chart:
    rows = [each for each in shown.points if each["state"] == "failed"]
    crosses = _chart("failures", rows).mark_text(text="\u2715", size=13, dy=8)
    return crosses.encode(x, y, colour)


def _bounds(shown: ChartData, x: alt.X, y: alt.Y) -> alt.Chart:
    """Return downward arrows at upper bounds: errors below the uncertainty of their reference."""
    rows = [each for each in shown.points if each["bound"] and each["state"] != "failed"]
    arrows = _chart("bounds", rows).mark_point(
        shape="arrow", angle=180, size=260, yOffset=14, color=INK
    )
    return arrows.encode(x, y)


def _front(shown: ChartData, x: alt.X, y: alt.Y) -> alt.Chart:
    """Return the front as a staircase: between two points, only the cheaper one is attainable."""
    line = _chart("front", shown.front).mark_line(
        strokeWidth=4, color=INK, opacity=0.35, interpolate="step-after"
    )
    return line.encode(x, y, order="time:Q")


def _floors(shown: ChartData, y: alt.Y, colour: alt.Color) -> alt.Chart:
    rules = _chart("floors", shown.floors).mark_rule(strokeDash=[2, 3], strokeWidth=1.5)
    return rules.encode(y, colour)


def _tolerance(shown: ChartData, limit: float) -> Iterator[alt.Chart]:
    band = [{"low": limit, "high": shown.frame.error[1]}]
    low = alt.Y("low:Q").scale(type="log", domain=shown.frame.error, nice=False)
    yield _chart("band", band).mark_rect(color="#f2f2f2").encode(low, alt.Y2("high:Q"))
    text = alt.Text("text:N")
    rows = [{"low": limit, "text": "tolerance", "time": shown.frame.time[1]}]
    x = alt.X("time:Q").scale(type="log", domain=shown.frame.time, nice=False)
    words = _chart("tolerance", rows)
    written = words.mark_text(align="right", dx=-4, dy=-7, color="#777777", fontSize=11)
    yield written.encode(x, low, text)


def _chosen(shown: ChartData, x: alt.X, y: alt.Y) -> Iterator[alt.Chart]:
    """Yield a ring around each recommended configuration, with its name."""
    rows = [each | _beside(each, shown) for each in shown.points if each["chosen"]]
    ring = _chart("chosen", rows)
    marked = ring.mark_point(shape="circle", size=420, strokeWidth=2.2, color=INK, opacity=1)
    yield marked.encode(x, y)
    placed = {name: alt.ExprRef(f"datum.{name}") for name in ("align", "dx", "dy")}
    bold = {"fontSize": 12, "fontWeight": "bold"}
    yield from _written("chosen", rows, "chosen", x, y, {**placed, **bold})


def _beside(row: dict[str, Any], shown: ChartData) -> dict[str, Any]:
    """Return where the name of a ring stands: within the frame, and not on the other name."""
    least, most = shown.frame.time
    right = row["time"] > math.sqrt(least * most)
    lower = min(each["error"] for each in shown.points if each["chosen"])
    return {
        "align": "right" if right else "left",
        "dx": -10 if right else 10,
        "dy": 18 if row["error"] == lower else -16,
    }


def _labels(shown: ChartData, x: alt.X, y: alt.Y) -> Iterator[alt.Chart]:
    """Yield the timesteps beside their points, on alternating sides by method."""
    rows = [
        each
        for each in shown.points
        if each["method"] != OTHERS and each["state"] != "failed" and not each["chosen"]
    ]
    if len(rows) > _MOST_LABELS:
        rows = [each for each in rows if each["labelled"]]
    right = [each for each in rows if shown.methods.index(each["method"]) % 2]
    left = [each for each in rows if each not in right]
    for side, part, align, dx in (("right", right, "left", 8), ("left", left, "right", -8)):
        style = {"align": align, "dx": dx, "dy": -dx, "fontSize": 10}
        yield from _written(f"labels {side}", part, "label", x, y, style)


def _written(
    name: str, rows: list[dict[str, Any]], field: str, x: alt.X, y: alt.Y, style: dict[str, Any]
) -> Iterator[alt.Chart]:
    """Yield text in front of a halo, so that lines do not strike it through."""
    for halo in ({"stroke": "white", "strokeWidth": 4, "strokeJoin": "round"}, {}):
        marked: dict[str, Any] = {"color": INK, **style, **halo}
        yield _chart(name, rows).mark_text(**marked).encode(x, y, text=f"{field}:N")


def _title(report: TradeoffReport) -> alt.TitleParams:
    feasible = sum(each.feasible for each in report.configurations)
    held = f"{feasible} of {len(report.configurations)}"
    return alt.TitleParams(
        f"{report.scene}: what accuracy costs in time",
        subtitle=[
            f"{held} configurations are feasible; grey line: their Pareto front;",
            "filled: within every tolerance; hollow: beyond one; cross: failed, or off the chart;",
            "arrow: upper bound; dotted: modelling error",
        ],
        anchor="start",
        fontSize=15,
        subtitleColor="#555555",
    )


def _chart(name: str, rows: list[dict[str, Any]]) -> alt.Chart:
    return alt.Chart(alt.InlineData(values=rows, name=name))
