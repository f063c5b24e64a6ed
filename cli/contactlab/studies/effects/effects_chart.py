"""Draws the time that a model takes without each of its features and parts."""

from pathlib import Path
from typing import Any

import altair as alt

from contactlab.charts import layer_of, word_colours
from contactlab.palette import COLOURS, INK, OTHERS_COLOUR
from contactlab.schema.effects_report import EffectsReport, PartEffect
from contactlab.studies.effects.effects_document import name_part

_COLOURS = {
    "needed": COLOURS[0],
    "near the tolerance": COLOURS[5],
    "below the tolerance": COLOURS[1],
    "unused": COLOURS[3],
    "not exercised": COLOURS[7],
    "not measured": OTHERS_COLOUR,
}
_MOST_BARS = 30


def draw_effects(report: EffectsReport) -> alt.TopLevelMixin:
    """Return the chart of the features and parts that were timed, those that cost most first."""
    timed_parts = [each for each in report.effects if each.time_ratio][:_MOST_BARS]
    rows = [_build_row(each) for each in timed_parts]
    y = alt.Y("name:N").sort([row["name"] for row in rows]).axis(title=None, labelLimit=240)
    x = alt.X("ratio:Q").scale(zero=False).title("time without it, over the time as written")
    x = x.axis(labelExpr="'x' + format(datum.value, '.2~f')")
    shown_verdicts = [
        verdict for verdict in _COLOURS if any(row["verdict"] == verdict for row in rows)
    ]
    colour = word_colours(
        "verdict", shown_verdicts, [_COLOURS[verdict] for verdict in shown_verdicts]
    ).title(None)
    bars = layer_of("effects", rows).mark_bar(opacity=0.8).encode(x, alt.X2("one:Q"), y, colour)
    spans = layer_of("effects", rows).mark_rule(color=INK)
    smaller = report.smaller
    saving = f"; the smaller model takes x{smaller.time_ratio.ratio:.2f}" if smaller else ""
    title = alt.TitleParams(
        f"{Path(report.model).name}: time of its features and parts",
        subtitle=f"time with its 95 % interval{saving}",
    )
    return (
        alt.layer(bars, spans.encode(alt.X("low:Q"), alt.X2("high:Q"), y))
        .properties(width=420, title=title)
        .configure_legend(orient="bottom", columns=3)
    )


def _build_row(part: PartEffect) -> dict[str, Any]:
    ratio = part.time_ratio
    assert ratio is not None
    return {
        "name": name_part(part),
        "verdict": part.verdict,
        "ratio": ratio.ratio,
        "low": ratio.low,
        "high": ratio.high,
        "one": 1.0,
    }
