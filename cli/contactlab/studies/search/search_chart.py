"""Time over error of all that was tried, with what decides as lines."""

from pathlib import Path

import altair as alt

from contactlab.charts import Rows, layer_of
from contactlab.palette import COLOURS, INK, OTHERS_COLOUR
from contactlab.printable import percent
from contactlab.schema.tune_report import Point, TuneReport
from contactlab.studies.search.choice import described

_ALIKE = 1.03  # ratio of times, and of errors, of points that are drawn as one
_GONE = 1e3  # of the limit: errors beyond it have no place in the picture
_MARKS = ["as written", "recommended", "keeps the aim", "as accurate as now"]
_WIDTH, _HEIGHT = 520, 340


def specification(report: TuneReport) -> alt.TopLevelMixin:
    """Return the chart: the model as written, what is recommended, the aim and what it is from."""
    rows = merged(report)
    unit = "share of the real forces" if report.aim.unit == "1" else report.aim.unit
    x = alt.X("time:Q").title("time, over that of the model as written").scale(type="log")
    y = alt.Y("error:Q").title(f"error [{unit}]").scale(type="log")
    tried = layer_of("tried", rows).encode(x=x, y=y, tooltip=["settings:N", "time:Q", "error:Q"])
    spans = layer_of("tried", rows).mark_rule(color=OTHERS_COLOUR)
    marked = [row for row in rows if row["what"]]
    special = layer_of("marked", marked).encode(x=x, y=y)
    lines, seen = _lines(report), {row["what"] for row in marked}
    colours = {mark: colour for mark, colour in zip(_MARKS, COLOURS, strict=False) if mark in seen}
    levels = layer_of("levels", lines).encode(y=alt.Y("error:Q"))
    # Side by side, since lines of nearly the same error are nearly one.
    names = [
        layer_of(f"level {place}", [line])
        .mark_text(align="left", baseline="bottom", dx=4, dy=-2, color=INK)
        .encode(x=alt.value(place * _WIDTH / len(lines)), y=levels.encoding.y, text="text:N")
        for place, line in enumerate(lines)
    ]
    return alt.layer(
        levels.mark_rule(color=INK, strokeDash=[4, 3]),
        *names,
        spans.encode(x=x, y=alt.Y("low:Q"), y2="high:Q"),
        tried.mark_point(filled=True, size=40, color=OTHERS_COLOUR, opacity=1),
        special.mark_point(filled=True, size=110, opacity=1).encode(
            color=alt.Color("what:N")
            .scale(domain=[*colours], range=[*colours.values()])
            .title(None)
        ),
    ).properties(width=_WIDTH, height=_HEIGHT, title=Path(report.model).name)


def merged(report: TuneReport) -> Rows:
    """Return a row for each point that can be told from others; both marks keep their own."""
    shown: list[tuple[Point, str]] = [(report.now, "as written")]
    if report.recommended:
        shown.append((report.recommended, "recommended"))
    if report.to_aim:
        shown.append((report.to_aim.point, "keeps the aim"))
    if report.as_accurate:
        shown.append((report.as_accurate.point, "as accurate as now"))
    shown += [(point, "") for point in report.points]
    rows: Rows = []
    for point, what in shown:
        if point.price is None or not point.error or point.error > _GONE * report.aim.limit:
            continue
        if not what and any(_alike(point, row["time"], row["error"]) for row in rows):
            continue
        rows.append(
            {
                "time": point.price.ratio,
                "error": point.error,
                "low": point.low or point.error,
                "high": point.high or point.error,
                "what": what,
                "settings": described({"timestep": point.timestep, **point.settings}),
            }
        )
    return rows


def _alike(point: Point, time: float, error: float) -> bool:
    assert point.price
    assert point.error
    ratios = point.price.ratio / time, point.error / error
    return all(1 / _ALIKE < ratio < _ALIKE for ratio in ratios)


def _lines(report: TuneReport) -> Rows:
    aim = report.aim
    if aim.unit != "1":
        return [{"error": aim.limit, "text": f"asked for: {aim.limit:.2g} {aim.unit}"}]
    lines: Rows = [{"error": aim.within, "text": f"tolerance {percent(aim.within)}"}]
    if aim.uncertain:
        lines.append({"error": aim.uncertain, "text": f"unknown anyway: {percent(aim.uncertain)}"})
    if aim.kind == "error":
        lines.append({"error": aim.limit, "text": f"asked for: {percent(aim.limit)}"})
    return lines
