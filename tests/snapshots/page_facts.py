"""What the page of a small sweep says: its visible text, and the data that its script is given.

Runs cost a microsecond of CPU a step, and machine and clock are made up, so that recommendations
are the same everywhere. Left out are pictures: what Vega and the renderer draw, and their code. The
specifications of charts, which hold the data that is drawn, are there.
"""

import base64
import gzip
import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from tests.snapshots.facts import fact_lines, section, value_text

_CPU_PER_STEP = 1e-6  # s
_DRAWN = {"svg", "style", "head"}
# Packed columns are in single precision, which has seven digits.
_DIGITS = 6
_MOST_WRITTEN = 16
_HOST = {"cpu_model": "CPU", "cpu_flags": "0" * 16, "cores": 1, "os": "OS"}
_MADE = {"contactlab": "0", "git_revision": None, "python": "3", "numpy": "2", "host": _HOST}
_THEN = "2000-01-01T00:00:00.000+00:00"


def page_text(folder: Path) -> str:
    """Run a sweep in a folder, the current one, and return the facts of its page."""
    page = _Page()
    page.feed(_page(folder))
    metadata = json.loads(_unpacked(page.held["metadata"]))
    series = json.loads(page.held["series"])
    columns = _columns(json.loads(page.held["columns"]))
    return (
        "".join(
            [
                section("text", page.texts),
                section("data", fact_lines(metadata, digits=_DIGITS)),
                section("columns", _column_lines(columns)),
                section("series", fact_lines(series["runs"])),
                section("packed series", _column_lines(_columns(series["packed"]))),
            ]
        ).rstrip()
        + "\n"
    )


def _page(folder: Path) -> str:
    import contactlab  # noqa: PLC0415 - collection is quick without
    from contactlab.page import page_view  # noqa: PLC0415 - an extra
    from contactlab.page.report_files import write_page  # noqa: PLC0415 - as above
    from contactlab.reporting.report import PageRequest  # noqa: PLC0415 - as above
    from contactlab.schema.evidence import Cost, Provenance  # noqa: PLC0415 - as above

    costs = Cost.of

    def made_up(cpu: float, steps: int, timestep: float, budget: float | None) -> Cost:
        del cpu
        return costs(steps * _CPU_PER_STEP, steps, timestep, budget)

    only = ["restitution=0.6", "drop_height=0.5,2.0"]
    with patch.object(Cost, "of", made_up):
        store = contactlab.sweep("bounce", output="bounce", only=only, workers=0)
    known = {"provenance": Provenance.model_validate(_MADE), "started": _THEN, "finished": _THEN}
    store = replace(store, manifest=store.manifest.model_copy(update=known))
    with (
        patch.object(page_view, "static_svg", lambda *_: "<svg></svg>"),
        patch.object(page_view, "vega_bundle", lambda: ""),
        patch.object(page_view, "header_films", lambda *_: page_view.Films([])),
        patch.object(page_view, "focal_picture", lambda *_: None),
    ):
        write_page(store, folder / "page.html", PageRequest())
    return (folder / "page.html").read_text(encoding="utf-8")


class _Page(HTMLParser):
    """Collects the text of a page, a line each, and what its script elements hold by their id."""

    def __init__(self) -> None:
        super().__init__()
        self.texts: list[str] = []
        self.held: dict[str, str] = {}
        self._drawn = 0
        self._script: str | None = None

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._drawn += tag in _DRAWN
        if tag == "script":
            self._script = dict(attrs).get("id") or ""

    def handle_endtag(self, tag: str) -> None:
        self._drawn -= tag in _DRAWN
        if tag == "script":
            self._script = None

    def handle_data(self, data: str) -> None:
        if self._script is not None:
            self.held[self._script] = self.held.get(self._script, "") + data
        elif not self._drawn and (text := " ".join(data.split())):
            self.texts.append(text)


def _unpacked(text: str) -> bytes:
    return gzip.decompress(base64.b64decode(text))


def _columns(packed: Mapping[str, Any]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield names and numbers of packed columns, whose bytes stand in the order of significance."""
    stream = np.frombuffer(_unpacked(packed["bytes"]), np.uint8)
    place = 0
    for name, kind, size in packed["columns"]:
        dtype = np.dtype(f"<{kind}")
        shuffled = stream[place : place + size * dtype.itemsize].reshape(dtype.itemsize, size)
        place += shuffled.size
        yield name, np.ascontiguousarray(shuffled.T).view(dtype).ravel()


def _column_lines(columns: Iterator[tuple[str, NDArray[Any]]]) -> list[str]:
    """Return a line a column: its numbers, or of a long one count, ends, extremes and mean."""
    lines: list[str] = []
    for name, numbers in columns:
        values = numbers.tolist()
        if len(values) > _MOST_WRITTEN:
            finite = numbers[np.isfinite(numbers)].astype(np.float64)
            stated = (values[0], values[-1], *map(float, (finite.min(), finite.max())))
            shown = f"{len(values)} values, {value_text((*stated, float(finite.mean())), _DIGITS)}"
        else:
            shown = value_text(values, _DIGITS)
        lines.append(f"{name} ({numbers.dtype.str[1:]}) = {shown}")
    return lines
