"""The charts of a page: specifications, and their pictures for pages without script."""

import re
from collections.abc import Iterator
from typing import Any

import altair as alt

from contactlab.contact import MODE_COLOURS, NO_CONTACT, SLIDE, STICK
from contactlab.report.heatmap import HALOED, MapFrame, label_map, label_rows, number_map
from contactlab.report.map_boundary import boundary_rows
from contactlab.report.map_cells import label_counts
from contactlab.report.report_columns import RunLabels
from contactlab.report.report_data import ReportData
from contactlab.report.vega_rendering import as_svg, inline_svg, themed, with_page_colours
from contactlab.schema import Configuration, Setting, Settings, TradeoffReport
from contactlab.tradeoff import COLOURS, INK, specify

_EMPTY = MapFrame((), (), "", "")
_BAR = 700, 26


def default_map(gathered: ReportData) -> dict[str, Any] | None:
    """Return the map of labels over the two axes that tell most."""
    if gathered.plane is None:
        return None
    pieces, letters = label_rows(label_counts(gathered.plane, gathered.outcomes), gathered.outcomes)
    return themed(
        label_map(
            MapFrame.of(gathered.plane),
            pieces,
            letters,
            gathered.outcomes,
            boundary_rows(gathered.plane, gathered.boundary),
        ).to_dict()
    )


def label_bar(outcomes: RunLabels) -> dict[str, Any]:
    """Return all runs as one bar, split by label."""
    rows: list[dict[str, Any]] = []
    before, total = 0, max(1, sum(outcomes.counts))
    for index, count in enumerate(outcomes.counts):
        ends = {"x": before / total, "x2": (before + count) / total}
        wide = count > 0.03 * total
        text = (outcomes.letters[index] or "stable") if wide else ""
        middle = (ends["x"] + ends["x2"]) / 2
        rows.append(
            ends | {"label": outcomes.legend[index], "text": text, "middle": middle, "runs": count}
        )
        before += count
    x = alt.X("x:Q").scale(domain=[0, 1]).axis(None)
    colour = (
        alt.Color("label:N")
        .scale(domain=list(outcomes.legend), range=list(outcomes.colours))
        .legend(None)
    )
    base = alt.Chart(alt.InlineData(values=rows, name="bar"))
    bar = base.mark_rect(stroke="white", strokeWidth=1).encode(x, colour, x2="x2:Q")
    middle = alt.X("middle:Q").scale(domain=[0, 1]).axis(None)
    words = [
        base.mark_text(fontWeight="bold", fontSize=13, **style).encode(middle, text="text:N")
        for style in HALOED
    ]
    chart = alt.layer(bar, *words).properties(width=_BAR[0], height=_BAR[1])
    return themed(chart.configure_view(stroke=None).to_dict())


def chart_templates(gathered: ReportData, chart: dict[str, Any] | None) -> dict[str, Any]:
    """Return the specifications that a page's script fills with data, in the page's colours."""
    found = {
        "labels": themed(label_map(_EMPTY, [], [], gathered.outcomes).to_dict()),
        "number": themed(number_map(_EMPTY, [], [], "").to_dict()),
        "timeline": themed(timeline_chart()),
        "tradeoff": chart,
    }
    return {name: with_page_colours(spec) for name, spec in found.items() if spec is not None}


def static_svg(spec: dict[str, Any] | None, name: str) -> str:
    """Return a chart as inline SVG; empty where there is none."""
    prefix = re.sub(r"\W+", "-", name.lower())
    return inline_svg(as_svg(with_page_colours(spec), f"{prefix}-"), name) if spec else ""


_MOST = 600
_TIMESTEP = "timestep"
_COUNT = re.compile(r"^\d+ of \d+")
Key = tuple[tuple[str, Setting], ...]


def tradeoff_chart(gathered: ReportData) -> dict[str, Any] | None:
    """Return accuracy against time; None where the store does not have both.

    Of very many configurations it shows those of the best methods, and some of the others.
    """
    report = gathered.weighing.report if gathered.weighing else None
    if report is None or not any(map(_has_place, report.configurations)):
        return None
    kept = _kept(report)
    shown = tuple(report.configurations[place] for place in kept)
    spec = specify(report.model_copy(update={"configurations": shown}))
    for layer in spec["layer"]:
        for row in layer["data"]["values"]:
            if "place" in row:
                row["place"] = kept[row["place"]]
    subtitle = spec["title"]["subtitle"]
    subtitle[0] = _COUNT.sub(_counted(report), subtitle[0])
    return themed(spec)


def _has_place(each: Configuration) -> bool:
    return each.time is not None and each.error is not None


def _counted(report: TradeoffReport) -> str:
    feasible = sum(each.feasible for each in report.configurations)
    return f"{feasible} of {len(report.configurations)}"


def _kept(report: TradeoffReport) -> list[int]:
    """Return the places of what is drawn: whole methods, those of the fronts before others."""
    found: dict[Key, list[int]] = {}
    for place, each in enumerate(report.configurations):
        found.setdefault(_method(each.configuration), []).append(place)
    kept: list[int] = []
    for key in dict.fromkeys((*_best(report), *_spread(list(found)))):
        if len(kept) < _MOST:
            kept += found[key]
    return sorted(kept)


def _best(report: TradeoffReport) -> Iterator[Key]:
    picks = [each for each in (report.recommendation, report.robust) if each is not None]
    for each in (*picks, *report.front, *report.unconstrained_front):
        yield _method(each.configuration)


def _spread(keys: list[Key]) -> Iterator[Key]:
    """Yield keys, those far from each other first."""
    stride = max(1, len(keys) // 64)
    for start in range(stride):
        yield from keys[start::stride]


def _method(values: Settings) -> Key:
    return tuple((name, value) for name, value in values.items() if name != _TIMESTEP)


MODES = {NO_CONTACT: "no contact", STICK: "stick", SLIDE: "slide"}
_WIDTH = 620
_LINES = {"motion": 120, "force": 120, "depth": 90}


def timeline_chart() -> dict[str, Any]:
    """Return charts above each other: motion, force, depth, and whether contacts stick or slide."""
    panels = [_lines(name, height) for name, height in _LINES.items()]
    chart = alt.vconcat(*panels, _ribbons(), spacing=8).resolve_scale(color="independent")
    return chart.to_dict()


def _lines(name: str, height: int) -> alt.Chart:
    x = alt.X("time:Q").scale(nice=False).axis(title=None, labels=False, ticks=False)
    y = alt.Y("value:Q").scale(zero=name != "motion").axis(title=name, format="~g", tickCount=4)
    colour = alt.Color("name:N").scale(range=[COLOURS[0], COLOURS[1]]).legend(title=None)
    return (
        _named(name)
        .mark_line(strokeWidth=1.4)
        .encode(x, y, colour, order="order:Q")
        .properties(width=_WIDTH, height=height)
    )


def _ribbons() -> alt.Chart:
    x = alt.X("time:Q").scale(nice=False).axis(title="simulated time [s]", format="~g")
    y = alt.Y("pair:N").axis(title=None, labelLimit=120)
    colour = (
        alt.Color("mode:N")
        .scale(domain=list(MODES.values()), range=[_colour(mode) for mode in MODES])
        .legend(title="contact")
    )
    return (
        _named("modes")
        .mark_bar(height=16, stroke=INK, strokeWidth=0)
        .encode(x, y, colour, x2="end:Q")
        .properties(width=_WIDTH, height={"step": 22})
    )


def _colour(mode: int) -> str:
    red, green, blue, _ = MODE_COLOURS[mode]
    return f"#{round(red * 255):02x}{round(green * 255):02x}{round(blue * 255):02x}"


def _named(name: str) -> alt.Chart:
    return alt.Chart(alt.InlineData(values=[], name=name))
