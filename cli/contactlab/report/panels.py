"""Figures that a page does not have, as Vega-Lite specifications."""

from collections.abc import Sequence
from typing import Any

import altair as alt

from contactlab.report.bounces import Bounces
from contactlab.report.changes import Change
from contactlab.report.impacts import Approach
from contactlab.tradeoff import COLOURS, INK, SHAPES

Rows = list[dict[str, Any]]
_ROOM = 3.0


def bounce_panels(found: Sequence[Bounces]) -> dict[str, Any]:
    """Return height over time, and the ratio of heights at each bounce against e^2."""
    names = [each.setting for each in found]
    colour = (
        alt.Color("setting:N")
        .scale(domain=names, range=list(COLOURS[: len(names)]))
        .legend(title=None)
    )
    heights: Rows = [
        {"time": time, "height": height, "setting": each.setting}
        for each in found
        for time, height in zip(each.time.tolist(), each.height.tolist(), strict=True)
    ]
    left = (
        _chart("heights", heights)
        .mark_line(strokeWidth=1.4)
        .encode(
            alt.X("time:Q").scale(nice=False).axis(title="time [s]"),
            alt.Y("height:Q").axis(title="height above first contact [m]"),
            colour,
        )
        .properties(width=420, height=260)
    )
    return alt.hconcat(left, _ratios(found, colour), spacing=30).to_dict()


def _ratios(found: Sequence[Bounces], colour: alt.Color) -> alt.LayerChart | alt.FacetChart:
    names = [each.setting for each in found]
    ratios: Rows = [
        {"bounce": index + 1, "ratio": ratio, "setting": each.setting}
        for each in found
        for index, ratio in enumerate(each.ratios.tolist())
    ]
    rules: Rows = [{"ratio": each.restitution**2, "setting": each.setting} for each in found]
    y = alt.Y("ratio:Q").scale(zero=True).axis(title="height after a bounce / before")
    shape = alt.Shape("setting:N").scale(domain=names, range=list(SHAPES[: len(names)]))
    points = (
        _chart("ratios", ratios)
        .mark_point(size=55, filled=True, opacity=1)
        .encode(
            alt.X("bounce:Q").axis(title="bounce", tickMinStep=1), y, colour, shape.legend(None)
        )
    )
    lines = _chart("squares", rules).mark_rule(strokeDash=[5, 4], strokeWidth=1.3)
    title = alt.TitleParams("dashed: e² of the contact", fontSize=11, fontWeight="normal")
    return alt.layer(lines.encode(y, colour), points).properties(width=260, height=260, title=title)


def cone_panel(found: Sequence[Approach]) -> dict[str, Any]:
    """Return impacts in velocity space, with the boundary of Coulomb's cone."""
    rows: Rows = [
        {
            "bound": each.bound,
            "slip": each.slip,
            "engine": each.engine,
            "contact": "sticks" if each.sticks else "slides throughout",
        }
        for each in found
    ]
    most = max(each.bound for each in found) * 1.08
    highest = max(each.slip for each in found) * 1.05
    x = alt.X("bound:Q").scale(domain=[0, most], nice=False)
    y = alt.Y("slip:Q").scale(domain=[0, highest], nice=False)
    x = x.axis(title="μ (1 + e) · normal speed before the impact [m/s]")
    y = y.axis(title="tangential speed before the impact [m/s]")
    names = ["sticks", "slides throughout"]
    colour = alt.Color("contact:N").scale(domain=names, range=list(COLOURS[:2])).legend(title=None)
    shape = alt.Shape("contact:N").scale(domain=names, range=["circle", "triangle-up"])
    end = min(most, highest)
    rows += [
        {"bound": value, "slip": value, "line": True, "engine": engine}
        for engine in dict.fromkeys(each.engine for each in found)
        for value in (0.0, end)
    ]
    base = alt.Chart(alt.InlineData(values=rows, name="impacts"))
    points = (
        base.transform_filter("!datum.line")
        .mark_point(size=60, filled=True, opacity=0.75)
        .encode(x, y, colour, shape.legend(title=None))
    )
    line = base.transform_filter("datum.line").mark_line(color=INK, strokeDash=[6, 4])
    chart = alt.layer(line.encode(x, y), points).properties(width=300, height=300)
    title = alt.Header(title="dashed: the cone's boundary; engine", titleFontWeight="normal")
    return chart.facet(column=alt.Column("engine:N").header(title)).to_dict()


def change_panels(found: Sequence[Change], names: Sequence[str]) -> dict[str, Any]:
    """Return bars of how many times more each change costs, and errs."""
    rows: Rows = [
        {
            "change": f"{each.axis}  {each.before} → {each.after}",
            "name": name,
            "ratio": ratio,
            "one": 1.0,
            "text": f"x {ratio:.3g}",
            "align": "left" if ratio >= 1 else "right",
            "dx": 5 if ratio >= 1 else -5,
        }
        for each in found
        for name in names
        if (ratio := each.ratios.get(name)) is not None
    ]
    order = list(dict.fromkeys(row["change"] for row in rows))
    panels = [
        _bars([row for row in rows if row["name"] == name], name, order, is_first=not index)
        for index, name in enumerate(names)
        if any(row["name"] == name for row in rows)
    ]
    return alt.hconcat(*panels, spacing=26).to_dict()


def _bars(
    rows: Rows, name: str, order: list[str], *, is_first: bool
) -> alt.LayerChart | alt.FacetChart:
    sizes = [row["ratio"] for row in rows]
    domain = [min(*sizes, 1.0) / _ROOM, max(*sizes, 1.0) * _ROOM]
    x = alt.X("ratio:Q").scale(type="log", domain=domain, nice=False)
    x = x.axis(title=f"{name}, after / before", format="~g", tickCount=5)
    y = alt.Y("change:N").scale(domain=order).axis(title=None, labelLimit=260, labels=is_first)
    colour = alt.condition("datum.ratio >= 1", alt.value(COLOURS[1]), alt.value(COLOURS[0]))
    data = _chart(f"changes {name}", rows)
    bars = data.mark_bar(height=13).encode(x, y, x2="one:Q", color=colour)
    align, dx = alt.ExprRef("datum.align"), alt.ExprRef("datum.dx")
    words = data.mark_text(fontSize=11, color=INK, align=align, dx=dx)
    words = words.encode(x, y, text="text:N")
    one = data.mark_rule(color=INK).encode(alt.X("one:Q").scale(type="log", domain=domain))
    return alt.layer(bars, one, words).properties(width=240, height={"step": 22})


def _chart(name: str, rows: Rows) -> alt.Chart:
    return alt.Chart(alt.InlineData(values=rows, name=name))
