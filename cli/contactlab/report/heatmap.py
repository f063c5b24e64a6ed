"""The heatmap as a Vega-Lite specification: labels by share, or one number a cell."""

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import altair as alt
import numpy as np
from numpy.typing import NDArray

from contactlab.contact import Floats
from contactlab.report.map_cells import MapAxes, most_frequent_failure
from contactlab.report.report_columns import RunLabels
from contactlab.tradeoff import INK

Rows = list[dict[str, Any]]
Layered = alt.LayerChart | alt.FacetChart

_ROOM = 560, 340
_CELL = (13, 112), (13, 56)
_GAP = 0.03
_DIVERGING = ["#1845fb", "#f4f4f4", "#ff5e02"]
_LEAST_RATIO = 1.02
_EDGE = 0.2
_MOST_WORDS = 12
SPANS_DECADES = 30.0
# Words are drawn twice: a halo, which makes them readable on any colour, and themselves.
HALOED: tuple[dict[str, Any], ...] = (
    {"stroke": "white", "strokeWidth": 3, "strokeJoin": "round", "color": INK},
    {"color": INK},
)


@dataclass(frozen=True)
class MapFrame:
    """What lies along the sides of a heatmap.

    Attributes:
        x: words along the axis across.
        y: words along the axis upwards.
        x_title: what the axis across is.
        y_title: what the axis upwards is; None for a single row.
        room: width and height that there is [pixels].
    """

    x: Sequence[str]
    y: Sequence[str]
    x_title: str
    y_title: str | None
    room: tuple[int, int] = _ROOM

    @classmethod
    def of(cls, plane: MapAxes, room: tuple[int, int] = _ROOM) -> "MapFrame":
        """Return the frame of two axes."""
        if plane.y is None:
            return cls(plane.x.words, ("",), plane.x.title, None, room)
        return cls(plane.x.words, plane.y.words, plane.x.title, plane.y.title, room)

    @property
    def size(self) -> tuple[float, float]:
        """Width and height [pixels]."""
        (least, most), (low, high) = _CELL
        across, up = max(1, len(self.x)), max(1, len(self.y))
        width = min(max(self.room[0] / across, least), most) * across
        return width, min(max(self.room[1] / up, low), high) * up


def label_rows(counts: NDArray[np.int64], outcomes: RunLabels) -> tuple[Rows, Rows]:
    """Return the pieces of each cell, as wide as their share of runs, and the letters on them.

    Args:
        counts: (rows, columns, labels) runs.
        outcomes: the labels.
    """
    main = most_frequent_failure(counts, outcomes)
    pieces: Rows = []
    letters: Rows = []
    for y, x in np.argwhere(counts.any(axis=-1)).tolist():
        ends = np.concatenate(([0], counts[y, x].cumsum())) / counts[y, x].sum()
        for code in np.flatnonzero(counts[y, x]).tolist():
            start, stop = ends[code : code + 2].tolist()
            pieces.append(_piece(x, y, start, stop) | {"label": outcomes.legend[code]})
            if code == main[y, x]:
                place = x + min(max((start + stop) / 2, _EDGE), 1 - _EDGE)
                letters.append({"x": place, "y": y + 0.5, "text": outcomes.letters[code]})
    return pieces, letters


def _piece(x: int, y: int, start: float, stop: float) -> dict[str, Any]:
    width = 1 - 2 * _GAP
    return {
        "x": round(x + _GAP + start * width, 6),
        "x2": round(x + _GAP + stop * width, 6),
        "y": y + _GAP,
        "y2": y + 1 - _GAP,
    }


def number_rows(values: Floats) -> tuple[Rows, Rows]:
    """Return a piece for each cell that has a value, and the values in words where they fit."""
    places = np.argwhere(np.isfinite(values)).tolist()
    pieces = [_piece(x, y, 0, 1) | {"value": float(values[y, x])} for y, x in places]
    if values.shape[1] > _MOST_WORDS:
        return pieces, []
    words = [{"x": x + 0.5, "y": y + 0.5, "text": f"{values[y, x]:.3g}"} for y, x in places]
    return pieces, words


def label_map(
    frame: MapFrame, pieces: Rows, letters: Rows, outcomes: RunLabels, boundary: Rows | None = None
) -> Layered:
    """Return the map of labels, with the lines of a closed form's boundary if there is one."""
    used = {row["label"] for row in pieces}
    colour = (
        alt.Color("label:N")
        .scale(domain=list(outcomes.legend), range=list(outcomes.colours))
        .legend(title="label", values=[name for name in outcomes.legend if name in used])
    )
    return _layered(frame, pieces, letters, colour, 13, boundary)


def number_map(
    frame: MapFrame, pieces: Rows, words: Rows, title: str, resolution: float = 0.0
) -> Layered:
    """Return the map of a number."""
    colour = (
        alt.Color("value:Q")
        .scale(scheme="cividis", **number_scale([row["value"] for row in pieces], resolution))
        .legend(title=title, format=".3~g", gradientLength=160)
    )
    return _layered(frame, pieces, words, colour, 10)


def ratio_map(frame: MapFrame, pieces: Rows, words: Rows, title: str) -> Layered:
    """Return the map of a ratio, in which 1 lies in the middle of the colours."""
    sizes = [abs(math.log(row["value"])) for row in pieces]
    reach = math.exp(max([*sizes, math.log(_LEAST_RATIO)]))
    colour = (
        alt.Color("value:Q")
        .scale(type="log", domain=[1 / reach, reach], range=_DIVERGING, nice=False)
        .legend(title=f"candidate / baseline, {title}", format=".3~g", gradientLength=160)
    )
    return _layered(frame, pieces, words, colour, 10)


def number_scale(values: Sequence[float], resolution: float) -> dict[str, Any]:
    """Return a logarithmic scale for positive numbers that span decades, else a linear one.

    What is zero lies at the lower end of a logarithmic scale, which has none.
    """
    sizes = sorted(value for value in values if value > resolution)
    if not sizes or min(values) < 0 or sizes[-1] < SPANS_DECADES * sizes[0]:
        return {"type": "linear", "zero": False, "nice": False}
    return {"type": "log", "domain": [sizes[0], sizes[-1]], "clamp": True, "nice": False}


def _layered(
    frame: MapFrame,
    pieces: Rows,
    texts: Rows,
    colour: alt.Color,
    size: int,
    boundary: Rows | None = None,
) -> Layered:
    x = alt.X("x:Q").scale(domain=[0, len(frame.x)], nice=False, zero=False)
    y = alt.Y("y:Q").scale(domain=[0, len(frame.y)], nice=False, zero=False)
    x = x.axis(title=frame.x_title, **_worded(frame.x), labelAngle=_angle(frame))
    y = y.axis(title=frame.y_title, **_worded(frame.y))
    cells = _chart("cells", pieces).mark_rect().encode(x, y, colour, x2="x2:Q", y2="y2:Q")
    width, height = frame.size
    chart = alt.layer(cells, *_written(texts, size, x, y), *_overlays(x, y, boundary or []))
    return chart.properties(width=width, height=height)


def _overlays(x: alt.X, y: alt.Y, boundary: Rows) -> Iterator[alt.Chart]:
    """Yield what is drawn over the cells: a closed form's boundary, and the cell in focus."""
    line = _chart("boundary", boundary).mark_line(color=INK, strokeWidth=2.5, strokeDash=[6, 3])
    yield line.encode(x, y, order="order:Q", detail="part:N")
    ring = _chart("ring", []).mark_rect(fill=None, stroke=INK, strokeWidth=3)
    yield ring.encode(x, y, x2="x2:Q", y2="y2:Q")


def _written(texts: Rows, size: int, x: alt.X, y: alt.Y) -> Iterator[alt.Chart]:
    """Yield words in front of a halo, which reads on any colour."""
    for style in HALOED:
        marked: dict[str, Any] = {"fontWeight": "bold", "fontSize": size, **style}
        yield _chart("words", texts).mark_text(**marked).encode(x, y, text="text:N")


def _worded(words: Sequence[str]) -> dict[str, Any]:
    """Return an axis that writes a word in the middle of each cell."""
    return {
        "values": [index + 0.5 for index in range(len(words))],
        "labelExpr": f"{json.dumps(list(words))}[floor(datum.value)]",
        "labelOverlap": True,
        "labelLimit": 140,
        "grid": False,
        "ticks": False,
        "domain": False,
    }


def _angle(frame: MapFrame) -> int:
    """Return how words across are turned: where they are wider than a cell."""
    widest = max(map(len, frame.x), default=0)
    return -35 if widest * 7 > frame.size[0] / max(1, len(frame.x)) else 0


def _chart(name: str, rows: Rows) -> alt.Chart:
    return alt.Chart(alt.InlineData(values=rows, name=name))
