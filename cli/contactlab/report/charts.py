"""The charts of a page: specifications, and their pictures for pages without script."""

import re
from typing import Any

import altair as alt

from contactlab.report.boundaries import boundary_rows
from contactlab.report.cells import label_counts
from contactlab.report.drawing import as_svg, inline
from contactlab.report.gathering import Gathered
from contactlab.report.heatmap import HALOED, Frame, label_map, label_rows, number_map
from contactlab.report.outcomes import Outcomes
from contactlab.report.theme import configured, on_page
from contactlab.report.timeline import timeline

_EMPTY = Frame((), (), "", "")
_BAR = 700, 26


def default_map(gathered: Gathered) -> dict[str, Any] | None:
    """Return the map of labels over the two axes that tell most."""
    if gathered.plane is None:
        return None
    pieces, letters = label_rows(label_counts(gathered.plane, gathered.outcomes), gathered.outcomes)
    return configured(
        label_map(
            Frame.of(gathered.plane),
            pieces,
            letters,
            gathered.outcomes,
            boundary_rows(gathered.plane, gathered.boundary),
        ).to_dict()
    )


def label_bar(outcomes: Outcomes) -> dict[str, Any]:
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
    return configured(chart.configure_view(stroke=None).to_dict())


def templates(gathered: Gathered, chart: dict[str, Any] | None) -> dict[str, Any]:
    """Return the specifications that a page's script fills with data, in the page's colours."""
    found = {
        "labels": configured(label_map(_EMPTY, [], [], gathered.outcomes).to_dict()),
        "number": configured(number_map(_EMPTY, [], [], "").to_dict()),
        "timeline": configured(timeline()),
        "tradeoff": chart,
    }
    return {name: on_page(spec) for name, spec in found.items() if spec is not None}


def pictured(spec: dict[str, Any] | None, name: str) -> str:
    """Return a chart as inline SVG; empty where there is none."""
    prefix = re.sub(r"\W+", "-", name.lower())
    return inline(as_svg(on_page(spec), f"{prefix}-"), name) if spec else ""
