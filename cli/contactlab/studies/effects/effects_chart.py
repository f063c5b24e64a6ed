"""The figure of an effects report: the change by each effect, and its time."""

from typing import Any

import altair as alt

from contactlab.charts import Rows, layer_of
from contactlab.schema.study_reports import EffectFinding, RecordedEffectsReport

# Bars end here; a changed label, or a metric that appears, is beyond any tolerance.
_MOST_TOLERANCES = 1e3
_LEAST_TOLERANCES = 1e-3
_Layers = alt.LayerChart | alt.FacetChart
# Petroff's sequence of six colors; each bar has its verdict as text as well.
_COLOURS = {
    "needed": "#e42536",
    "missing": "#964a8b",
    "below the tolerance": "#5790fc",
    "not exercised": "#7a21dd",
    "saves time": "#f89c20",
    "no effect": "#9c9ca1",
}


def specification(report: RecordedEffectsReport) -> alt.TopLevelMixin:
    """Return the chart of a report: two columns of bars, one row per effect."""
    rows = [_row(finding) for finding in report.effects if finding.verdict != "unused"]
    y = alt.Y("effect:N").sort([row["effect"] for row in rows])
    colour = alt.Color("verdict:N").scale(domain=list(_COLOURS), range=list(_COLOURS.values()))
    return (
        alt.hconcat(
            _changes(rows, y.axis(title=None), colour.legend(None)),
            _costs(rows, y.axis(labels=False, title=None), colour.legend(None)),
        )
        .properties(title=_title(report))
        .configure_axis(labelLimit=240)
    )


def _row(finding: EffectFinding) -> dict[str, Any]:
    cost = finding.time_ratio
    state = "on" if finding.on else "off"
    sizes = [
        _MOST_TOLERANCES if change.ratio_to_tolerance is None else change.ratio_to_tolerance
        for change in finding.metric_changes
    ]
    times = _MOST_TOLERANCES if finding.labels else max(sizes, default=0.0)
    return {
        "effect": f"{finding.effect} ({state})",
        "verdict": finding.verdict,
        "times": min(max(times, _LEAST_TOLERANCES), _MOST_TOLERANCES),
        "left": _LEAST_TOLERANCES,
        "ratio": cost and cost.ratio,
        "low": cost and cost.low,
        "high": cost and cost.high,
        "one": 1.0,
    }


def _changes(rows: Rows, y: alt.Y, colour: alt.Color) -> _Layers:
    x = alt.X("left:Q").scale(type="log", domain=[_LEAST_TOLERANCES, _MOST_TOLERANCES])
    x = x.axis(title="largest change when changed, in tolerances", format="~g")
    bars = layer_of("effects", rows).mark_bar().encode(x, alt.X2("times:Q"), y, colour)
    words = layer_of("effects", rows).mark_text(align="left", dx=4, fontSize=11)
    named = words.encode(alt.X("times:Q"), y, alt.Text("verdict:N"))
    rule = layer_of("limit", [{"limit": 1}]).mark_rule(strokeDash=[4, 3]).encode(alt.X("limit:Q"))
    return alt.layer(bars, named, rule).properties(width=320)


def _costs(rows: Rows, y: alt.Y, colour: alt.Color) -> _Layers:
    timed = [row for row in rows if row["ratio"]]
    x = alt.X("one:Q").scale(zero=False).axis(title="CPU time, changed over base", format="~g")
    bars = layer_of("timed", timed).mark_bar().encode(x, alt.X2("ratio:Q"), y, colour)
    spans = layer_of("timed", timed).mark_rule().encode(alt.X("low:Q"), alt.X2("high:Q"), y)
    return alt.layer(bars, spans).properties(width=320)


def _title(report: RecordedEffectsReport) -> alt.TitleParams:
    saving = report.time_ratio
    cost = "" if saving is None else f"; the smallest set takes {saving.ratio:.2f} of the time"
    count = len(report.scenarios) * len(report.seeds)
    return alt.TitleParams(
        f"Effects of {report.scene}", subtitle=f"each changed alone, over {count} runs{cost}"
    )
