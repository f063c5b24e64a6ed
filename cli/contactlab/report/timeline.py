"""One run over time as a Vega-Lite specification, whose data a page fills in."""

from typing import Any

import altair as alt

from contactlab.contact import MODE_COLOURS, NO_CONTACT, SLIDE, STICK
from contactlab.tradeoff import COLOURS, INK

MODES = {NO_CONTACT: "no contact", STICK: "stick", SLIDE: "slide"}
_WIDTH = 620
_LINES = {"motion": 120, "force": 120, "depth": 90}


def timeline() -> dict[str, Any]:
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
