"""Small films for the head of a page: of a stable run, and of the run to look at first."""

import base64
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import numpy as np

from contactlab.errors import ContactlabError
from contactlab.plugins import extensions
from contactlab.reporting.report import ReportData
from contactlab.store.finished_store import Store

_SIZE = (208, 156)
# How long a film lasts, however long its run is [s].
_SECONDS = 1.2
_MOST_BYTES_OF_A_FILM = 600_000


class HeaderFilm(NamedTuple):
    """A film as the source of an image, of a run with a label."""

    run: str
    label: str
    source: str


def header_films(data: ReportData, worst: str | None) -> list[HeaderFilm]:
    """Return films of a stable run, the recommended one if there is one, and of the worst.

    There are none of runs without a trace, and where films cannot be drawn.
    """
    films: list[HeaderFilm] = []
    if find_spec("mujoco") is None:
        # The rest of a page needs no engine.
        return films
    for run in dict.fromkeys(filter(None, (_stable(data), worst))):
        with suppress(ContactlabError):
            films += _film_of(data.store, run)
    return films


def _stable(data: ReportData) -> str | None:
    if data.tradeoff and data.tradeoff.recommendation:
        return data.tradeoff.recommendation.run_id
    rows = np.flatnonzero(~data.labels.failed)
    return str(data.store.columns.run_ids[int(rows[0])]) if len(rows) else None


def _film_of(store: Store, run: str) -> Iterator[HeaderFilm]:
    viewer, record = extensions("viewer").get("gif"), store.record(run)
    if viewer is None or record.trace is None or store.manifest.traces_left_out:
        return
    seconds = float(store.trace(record).time[-1])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.gif"
        speed = min(max(seconds / _SECONDS, 0.001), 1000.0)
        viewer.load()(store, run, path, size=_SIZE, camera=None, speed=speed, at=())
        content = path.read_bytes()
    if len(content) <= _MOST_BYTES_OF_A_FILM:
        encoded = base64.b64encode(content).decode()
        yield HeaderFilm(run, record.label, f"data:image/gif;base64,{encoded}")
