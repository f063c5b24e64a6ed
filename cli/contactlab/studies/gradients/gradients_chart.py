"""Figures of a gradients report: differences over their spans, or the verdicts on a map."""

from itertools import pairwise

import altair as alt

from contactlab.charts import Rows, layer_of, word_colours
from contactlab.schema.gradients import GRADIENT_VERDICTS, GradientsReport
from contactlab.studies.gradients.differentiating import find_mode_switches

# Petroff's colors, with a calm one for derivatives that can be used.
_COLOURS = ("#dbe5de", "#f89c20", "#5790fc", "#e42536", "#9c9ca1")


def chart_gradients(report: GradientsReport) -> alt.TopLevelMixin:
    """Return the chart of a report."""
    return _map_chart(report) if report.axes else _ladder_chart(report)


def _chart_title(report: GradientsReport) -> alt.TitleParams:
    what = f"derivative of {report.output_coordinate} after {report.duration:g} s"
    return alt.TitleParams(f"{report.scene}: {what}")


def _ladder_chart(report: GradientsReport) -> alt.TopLevelMixin:
    """Return differences over their spans and the model's derivative, one plot per input."""
    (place,) = report.places
    panels: list[alt.LayerChart | alt.FacetChart] = []
    most_drawn = 50.0  # largest drawn value, in multiples of the model's derivative
    for name, by in place.inputs.items():
        model = by.model.value or 0.0
        most = most_drawn * max(abs(model), by.model.bound or 0.0, 1e-12)
        rows = [
            {
                "span": rung.span,
                "step": f"{1e3 * rung.step:g} ms",
                "value": min(max(rung.value, -most), most),
            }
            for rung in by.ladder
            if rung.value is not None
        ]
        x = alt.X("span:Q").scale(type="log")
        x = x.axis(title=f"span of {name}", format="~e", tickCount=5)
        constant = max(abs(model) / 2, 1e-12)
        y = alt.Y("value:Q").scale(type="symlog", constant=constant)
        lines = layer_of(f"ladder {name}", rows).mark_line(point=True)
        ladder_lines = lines.encode(
            x, y.axis(title="difference", tickCount=6), alt.Color("step:N", sort=None)
        )
        bound = by.model.bound or 0.0
        band: Rows = [{"low": model - bound, "high": model + bound, "value": model}]
        layer = layer_of(f"model {name}", band)
        shade = layer.mark_rect(opacity=0.2, color="#5790fc")
        shade = shade.encode(alt.Y("low:Q"), alt.Y2("high:Q"))
        rule = layer.mark_rule(color="#5790fc").encode(alt.Y("value:Q"))
        panels.append(alt.layer(shade, rule, ladder_lines).properties(width=260, height=170))
    chart = alt.concat(*panels, columns=2).resolve_scale(x="independent", y="independent")
    return chart.properties(title=_chart_title(report))


def _map_chart(report: GradientsReport) -> alt.TopLevelMixin:
    """Return the verdicts on a map with lines at mode switches, by input and method."""
    (first, across), *rest = report.axes.items()
    second, along = rest[0] if rest else ("", (0.0,))
    width = _cell_edges(across), _cell_edges(along)
    boxes = [
        {"x": width[0][i], "x2": width[0][i + 1], "y": width[1][j], "y2": width[1][j + 1]}
        for i in range(len(across))
        for j in range(len(along))
    ]
    lines: Rows = []
    for one, other in find_mode_switches(report.axes, report.places):
        box, neighbor = boxes[one], boxes[other]
        if neighbor["x"] > box["x"]:
            lines.append({"x": neighbor["x"], "x2": neighbor["x"], "y": box["y"], "y2": box["y2"]})
        else:
            lines.append({"x": box["x"], "x2": box["x2"], "y": neighbor["y"], "y2": neighbor["y"]})
    x, y = alt.X("x:Q").scale(zero=False), alt.Y("y:Q").scale(zero=False)
    x, y = x.axis(title=first, grid=False), y.axis(title=second or None, grid=False)
    colour = word_colours("word", list(GRADIENT_VERDICTS), _COLOURS)
    colour = colour.legend(title=None, orient="bottom")
    panels: list[alt.LayerChart | alt.FacetChart] = []
    for band in report.bands:
        rows = [
            {**box, "word": place.inputs[band.parameter].verdicts[band.method]}
            for box, place in zip(boxes, report.places, strict=True)
        ]
        name = f"{band.parameter}, {band.method}"
        tiles = layer_of(name, rows).mark_rect(stroke="white", strokeWidth=0.5)
        tiles = tiles.encode(x, alt.X2("x2:Q"), y, alt.Y2("y2:Q"), colour)
        edge = layer_of(f"mode switches {name}", lines).mark_rule(strokeWidth=2)
        edges = edge.encode(x, alt.X2("x2:Q"), y, alt.Y2("y2:Q"))
        layers = alt.layer(tiles, edges) if lines else alt.layer(tiles)
        panels.append(layers.properties(width=320, height=200, title=f"by {name}"))
    chart = alt.concat(*panels, columns=2)
    return chart.properties(title=_chart_title(report))


def _cell_edges(values: tuple[float, ...]) -> list[float]:
    """Return the edges of cells about values, half way between neighbors."""
    if len(values) == 1:
        return [values[0] - 0.5, values[0] + 0.5]
    middles = [(low + high) / 2 for low, high in pairwise(values)]
    return [2 * values[0] - middles[0], *middles, 2 * values[-1] - middles[-1]]
