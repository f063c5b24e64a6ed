"""Chart of counted work over error of every candidate, with target and tolerance as lines."""

from pathlib import Path

import altair as alt

from contactlab.charts import Rows, layer_of
from contactlab.palette import COLOURS, INK, OTHERS_COLOUR
from contactlab.rendering.amounts import format_percent
from contactlab.schema.time_ratio import LEAST_SAVING
from contactlab.schema.tune_report import Candidate, TuneReport
from contactlab.studies.search.configuration import format_settings

_MERGE_RATIO = 1 + LEAST_SAVING  # of works, and of errors: candidates that are drawn as one
_MAX_ERROR_RATIO = 1e3  # of the limit: larger errors are not drawn
_MARKS = ["as written", "recommended", "equal error"]
_WIDTH, _HEIGHT = 520, 340


def specification(report: TuneReport) -> alt.TopLevelMixin:
    """Return the chart: candidates, the recommended one, the target and its source."""
    rows = merge_candidates(report)
    unit = "share of the real forces" if report.target.unit == "1" else report.target.unit
    x = alt.X("time:Q").title("counted work, over that as written").scale(type="log")
    y = alt.Y("error:Q").title(f"error [{unit}]").scale(type="log")
    tried = layer_of("tried", rows).encode(x=x, y=y, tooltip=["settings:N", "time:Q", "error:Q"])
    spans = layer_of("tried", rows).mark_rule(color=OTHERS_COLOUR)
    marked = [row for row in rows if row["what"]]
    special = layer_of("marked", marked).encode(x=x, y=y)
    lines, seen = _error_lines(report), {row["what"] for row in marked}
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


def merge_candidates(report: TuneReport) -> Rows:
    """Return a row for each distinct candidate; marked candidates keep their own rows."""
    shown: list[tuple[Candidate, str]] = [(report.current, "as written")]
    if report.recommended:
        shown.append((report.recommended, "recommended"))
    if report.equal_error:
        shown.append((report.equal_error.candidate, "equal error"))
    shown += [(candidate, "") for candidate in report.candidates]
    rows: Rows = []
    for candidate, what in shown:
        if (
            candidate.cost is None
            or not candidate.error
            or candidate.error > _MAX_ERROR_RATIO * report.target.limit
        ):
            continue
        if not what and any(_is_close(candidate, row["time"], row["error"]) for row in rows):
            continue
        rows.append(
            {
                "time": candidate.cost,
                "error": candidate.error,
                "low": candidate.low or candidate.error,
                "high": candidate.high or candidate.error,
                "what": what,
                "settings": format_settings({"timestep": candidate.timestep, **candidate.settings}),
            }
        )
    return rows


def _is_close(candidate: Candidate, time: float, error: float) -> bool:
    assert candidate.cost
    assert candidate.error
    ratios = candidate.cost / time, candidate.error / error
    return all(1 / _MERGE_RATIO < ratio < _MERGE_RATIO for ratio in ratios)


def _error_lines(report: TuneReport) -> Rows:
    target = report.target
    if target.unit != "1":
        return [{"error": target.limit, "text": f"requested: {target.limit:.2g} {target.unit}"}]
    lines: Rows = [
        {"error": target.tolerance, "text": f"tolerance {format_percent(target.tolerance)}"}
    ]
    if target.kind == "error":
        lines.append({"error": target.limit, "text": f"requested: {format_percent(target.limit)}"})
    return lines
