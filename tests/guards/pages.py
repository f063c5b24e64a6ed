"""Five pages: their visible texts, and of one the data that its script is given.

Machine and clock are made up, so that recommendations are the same everywhere. Left out are
pictures, which Vega and the renderer draw, and their code. The specifications of charts, which hold
the data that is drawn, are kept.
"""

import base64
import gzip
import json
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from tests.guards.counted_clock import counted_time
from tests.guards.reading import nested_facts, parted
from tests.guards.records import Facts, Items
from tests.guards.steady import MACHINE, THEN, made_up_machine
from tests.guards.sweeps import SWEEPS

# ruff: noqa: PLC0415 - collection is quick without

_DRAWN = {"svg", "style", "head"}
# Packed columns are in single precision, which has seven digits.
_DIGITS = 6
_MOST_WRITTEN = 16
_EXAMINED = Path(__file__).parents[2] / "models" / "stiff_joint" / "scene.xml"


def _sweep_page(name: str, folder: Path) -> Path:
    import contactlab
    from contactlab.page.report_files import write_page
    from contactlab.reporting.report import PageRequest
    from contactlab.schema.evidence import Provenance

    with made_up_machine(), counted_time():
        store = contactlab.sweep(name, output=name, where=SWEEPS[name], workers=0)
    then = THEN.isoformat(timespec="milliseconds")
    known = {"provenance": Provenance.model_validate(MACHINE), "started": then, "finished": then}
    store = replace(store, manifest=store.manifest.model_copy(update=known))
    with _undrawn():
        write_page(store, folder / "page.html", PageRequest())
    return folder / "page.html"


def _examination_page(folder: Path) -> Path:
    import contactlab

    model = folder / "model.xml"
    model.write_bytes(_EXAMINED.read_bytes())
    with made_up_machine(), counted_time(), _undrawn():
        contactlab.examine("model.xml", output="examined", duration="1 s", workers=1)
    return folder / "examined" / "page.html"


@contextmanager
def _undrawn() -> Generator[None]:
    """Leave pictures out of pages."""
    from contactlab.page import examination_view, page_view

    with (
        patch.object(page_view, "static_svg", lambda *_: "<svg></svg>"),
        patch.object(examination_view, "static_svg", lambda *_: "<svg></svg>"),
        patch.object(page_view, "vega_bundle", lambda: ""),
        patch.object(page_view, "header_films", lambda *_, **_drawn: page_view.Films([])),
        patch.object(page_view, "focal_picture", lambda *_: None),
    ):
        yield


PAGES: Mapping[str, Callable[[Path], Path]] = {
    **{
        f"sweep {name}": partial(_sweep_page, name)
        for name in ("bounce", "impact", "grasp", "tradeoff-stack")
    },
    "examination": _examination_page,
}
_WITH_DATA = "sweep bounce"
LONG = {"sweep bounce", "sweep grasp", "sweep tradeoff-stack", "examination"}
"""Those that take seconds: they read all data, sweep 48 runs, or measure an error budget."""


def page_items(name: str, folder: Path) -> tuple[Items, Items]:
    """Make a page in a folder, the current one, and return its data and its text."""
    page = _Page()
    page.feed(PAGES[name](folder).read_text(encoding="utf-8"))
    words = {"text": page.texts}
    if name != _WITH_DATA:
        return {}, {"page": {name: words}}
    data, said = parted(_data(page.held), lambda _, value: isinstance(value, str))
    return {"page": {name: data}}, {"page": {name: words | said}}


def _data(held: Mapping[str, str]) -> Facts:
    metadata = json.loads(_unpacked(held["metadata"]))
    series = json.loads(held["series"])
    return {
        "data": nested_facts(_rounded(metadata)),
        "columns": dict(_described(_columns(json.loads(held["columns"])))),
        "series": nested_facts({"runs": series["runs"]}),
        "packed series": dict(_described(_columns(series["packed"]))),
    }


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


def _described(columns: Iterator[tuple[str, NDArray[Any]]]) -> Iterator[tuple[str, Any]]:
    """Yield the numbers of each column, or of a long one count, ends, extremes and mean."""
    for name, numbers in columns:
        values = numbers.tolist()
        if len(values) > _MOST_WRITTEN:
            finite = numbers[np.isfinite(numbers)].astype(np.float64)
            stated = [values[0], values[-1], *map(float, (finite.min(), finite.max()))]
            values = [len(values), *stated, float(finite.mean())]
        yield f"{name} ({numbers.dtype.str[1:]})", _rounded(values)


def _rounded(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _rounded(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(one) for one in value]
    return float(f"{value:.{_DIGITS}g}") if isinstance(value, float) else value
