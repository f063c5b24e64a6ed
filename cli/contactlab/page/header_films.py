"""Pictures of a page: the worst moment beside the best run, and films of both."""

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

_SIZE = (320, 240)
_FOCAL_SIZE = (480, 360)  # of each of its halves
# How long a film lasts, however long its run is [s].
_SECONDS = 1.2
_MOST_BYTES_OF_A_FILM = 1_500_000
_SIZE_OF_MOMENT = (480, 360)
# A moment is shown with so much of the run around it, of which a share is before [s], for so long.
_SHOWN, _BEFORE, _SECONDS_OF_MOMENT = 0.3, 0.6, 1.6


class HeaderFilm(NamedTuple):
    """A film as the source of an image, of a run with a label."""

    run: str
    label: str
    source: str


class FocalPicture(NamedTuple):
    """The worst run at its worst moment, beside the best one then, as the source of an image."""

    run: str
    label: str
    beside: str
    time: float  # [s]
    source: str


def focal_picture(data: ReportData, worst: str | None) -> FocalPicture | None:
    """Return the picture that says most; None where either run has no trace, or cannot be drawn.

    The worst moment is that at which its label begins.
    """
    best = _stable(data)
    if worst is None or best is None or best == worst or find_spec("mujoco") is None:
        return None
    store, viewer = data.store, extensions("viewer").get("png")
    record, other = store.record(worst), store.record(best)
    if viewer is None or store.manifest.traces_left_out or not (record.trace and other.trace):
        return None
    with suppress(ContactlabError), tempfile.TemporaryDirectory() as folder:
        times = store.trace(record).time
        begins = [entry.step for entry in record.labels if entry.step is not None]
        time = float(times[min(begins[0], len(times) - 1)]) if begins else float(times[-1])
        path = Path(folder) / "moment.png"
        viewer.load()(
            store, worst, path, size=_FOCAL_SIZE, camera=None, speed=None, at=(time,), beside=best
        )
        return FocalPicture(worst, record.label, best, time, _encoded(path, "png"))
    return None


def _encoded(path: Path, kind: str) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(path.read_bytes()).decode()}"


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
            films += film_of(data.store, run)
    return films


def _stable(data: ReportData) -> str | None:
    if data.tradeoff and data.tradeoff.recommendation:
        return data.tradeoff.recommendation.run_id
    rows = np.flatnonzero(~data.labels.failed)
    return data.store.columns.run_id(int(rows[0])) if len(rows) else None


class Moment(NamedTuple):
    """A moment of a run: the worst window of a body [s], and what is said of it."""

    run: str
    body: str
    begin: float
    end: float
    words: str


def film_of_moment(store: Store, moment: Moment) -> HeaderFilm | None:
    """Return a film in slow motion of what leads to a moment and follows it, from near the body.

    None where no film can be drawn.
    """
    viewer = extensions("viewer").get("gif")
    if viewer is None or find_spec("mujoco") is None or store.record(moment.run).trace is None:
        return None
    between = moment.begin - _BEFORE * _SHOWN, moment.end + (1 - _BEFORE) * _SHOWN
    with suppress(ContactlabError), tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "moment.gif"
        speed = (between[1] - between[0]) / _SECONDS_OF_MOMENT
        viewer.load()(
            store,
            moment.run,
            path,
            size=_SIZE_OF_MOMENT,
            camera=None,
            speed=speed,
            at=(),
            between=between,
            around=moment.body,
        )
        return HeaderFilm(moment.run, moment.words, _encoded(path, "gif"))
    return None


def film_in(file: Path, words: str) -> HeaderFilm | None:
    """Return a film of a file that was drawn before, .gif; None if it is too large for a page."""
    if file.stat().st_size > _MOST_BYTES_OF_A_FILM:
        return None
    return HeaderFilm("", words, _encoded(file, "gif"))


def film_of(store: Store, run: str) -> Iterator[HeaderFilm]:
    """Yield the film of a run; nothing of one without a trace, or where none can be drawn."""
    viewer, record = extensions("viewer").get("gif"), store.record(run)
    if viewer is None or record.trace is None or store.manifest.traces_left_out:
        return
    seconds = float(store.trace(record).time[-1])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.gif"
        speed = min(max(seconds / _SECONDS, 0.001), 1000.0)
        viewer.load()(store, run, path, size=_SIZE, camera=None, speed=speed, at=())
        size, source = path.stat().st_size, _encoded(path, "gif")
    if size <= _MOST_BYTES_OF_A_FILM:
        yield HeaderFilm(run, record.label, source)
