"""Draws the time that a model takes without each of its features and parts."""

from typing import Any

import altair as alt

from contactlab.charts import layer_of
from contactlab.schema.effects_report import EffectsReport, PartEffect

_COLOURS = {
    "needed": "#4c78a8",
    "near the tolerance": "#72b7b2",
    "below the tolerance": "#54a24b",
    "unused": "#8a8a8a",
    "not exercised": "#bab0ac",
    "not measured": "#bab0ac",
}
_MOST_BARS = 30


def specification(report: EffectsReport) -> Any:  # noqa: ANN401 - a chart of altair
    """Return the chart of the features and parts that were timed, those that cost most first."""
    timed = [each for each in report.effects if each.time_ratio][:_MOST_BARS]
    rows = [_build_row(each) for each in timed]
    y = alt.Y("name:N").sort([row["name"] for row in rows]).axis(title=None, labelLimit=240)
    x = alt.X("ratio:Q").scale(zero=False).axis(title="time without it, over time with it")
    colour = alt.Color("verdict:N").scale(domain=list(_COLOURS), range=list(_COLOURS.values()))
    bars = layer_of("effects", rows).mark_bar().encode(x, alt.X2("one:Q"), y, colour)
    spans = layer_of("effects", rows).mark_rule().encode(alt.X("low:Q"), alt.X2("high:Q"), y)
    smaller = report.smaller
    cost = f"the smaller model takes x{smaller.time_ratio.ratio:.2f}" if smaller else " "
    title = alt.TitleParams(f"Features and parts of {report.model}", subtitle=cost)
    return alt.layer(bars, spans).properties(width=420, title=title)


def _build_row(part: PartEffect) -> dict[str, Any]:
    ratio = part.time_ratio
    assert ratio is not None
    return {
        "name": f"add {part.name}" if part.adds else f"{part.kind} {part.name}",
        "verdict": part.verdict,
        "ratio": ratio.ratio,
        "low": ratio.low,
        "high": ratio.high,
        "one": 1.0,
    }
