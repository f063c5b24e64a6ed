"""Pictures of a page: the worst moment next to the best run, and films of both, or drawings."""

import base64
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from contactlab.errors import ContactlabError, OutputError, SceneError
from contactlab.plugins import find_extensions
from contactlab.reporting.report import ReportData
from contactlab.store.finished_store import Store


@dataclass(frozen=True)
class FilmRules:
    """Sizes [pixels] and lengths of films and pictures; a second of film costs as much as a page.

    Attributes:
        size: of a film of a whole run.
        seconds: length of such a film, for runs of any length [s].
        most_bytes: a larger film is left out, so that a page opens at once.
        moment_size: of a film or a drawing of a moment, and of each half of the focal picture.
        shown_share: simulated time around a moment [s].
        before: share of this time before the moment.
        moment_seconds: length of the film of a moment [s].
    """

    size: tuple[int, int] = (320, 240)
    seconds: float = 1.2
    most_bytes: int = 1_500_000
    moment_size: tuple[int, int] = (480, 360)
    shown_share: float = 0.3
    before: float = 0.6
    moment_seconds: float = 0.8


FILM_RULES = FilmRules()


class HeaderFilm(NamedTuple):
    """A film as the source of an image, of a run with a label."""

    run: str
    label: str
    source: str
    moves: bool = True  # whether it is a film, not a drawing of one moment


class Films(NamedTuple):
    """Films of a page, or the reason for none."""

    films: list[HeaderFilm]
    missing: str = ""


class FocalPicture(NamedTuple):
    """The worst run at its worst moment, next to the best one then, as the source of an image."""

    run: str
    label: str
    best_run: str
    time: float  # [s]
    source: str


def focal_picture(data: ReportData, worst: str | None) -> FocalPicture | None:
    """Return the picture that says most; None if a run has no trace, or cannot be drawn.

    The worst moment is the begin of its label.
    """
    best, store = _find_stable_run(data), data.store
    if worst is None or best is None or best == worst:
        return None
    with suppress(ContactlabError), tempfile.TemporaryDirectory() as folder:
        record = store.record(worst)
        times = store.trace(record).time
        begins = [entry.step for entry in record.labels if entry.step is not None]
        time = float(times[min(begins[0], len(times) - 1)]) if begins else float(times[-1])
        path = Path(folder) / "moment.png"
        try:
            _load_viewer("png")(
                store,
                worst,
                path,
                size=FILM_RULES.moment_size,
                camera=None,
                speed=None,
                at=(time,),
                other_run=best,
            )
            source = _encode_picture(path, "png")
        except (OutputError, SceneError):
            source = _draw_moment(store, Moment(worst, "", time, time, "", best))
        return FocalPicture(worst, record.label, best, time, source)
    return None


def _encode_picture(path: Path, kind: str) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(path.read_bytes()).decode()}"


def header_films(data: ReportData, worst: str | None, *, has_moment: bool) -> Films:
    """Return films of a stable run, the recommended one if there is one, and of the worst.

    If a film needs a package that is not installed, or OpenGL, there is a drawing of the last
    moment of the run, unless the moment of the worst is drawn already.
    """
    films, missing = list[HeaderFilm](), ""
    for run in dict.fromkeys(filter(None, (_find_stable_run(data), worst))):
        try:
            films += film_of(data.store, run)
        except (OutputError, SceneError) as error:
            missing = "" if has_moment else str(error)
            if has_moment:
                continue
            record = data.store.record(run)
            with suppress(ContactlabError):
                end = float(data.store.trace(record).time[-1])
                source = _draw_moment(data.store, Moment(run, "", end, end, ""))
                films.append(HeaderFilm(run, record.label, source, moves=False))
        except ContactlabError as error:
            missing = str(error)
    return Films(films, "" if films else missing)


def _draw_moment(store: Store, moment: "Moment") -> str:
    """Draw the begin of a moment without OpenGL and other packages, as the source of an image."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "moment.svg"
        _load_viewer("svg")(
            store,
            moment.run,
            path,
            size=FILM_RULES.moment_size,
            camera=None,
            speed=None,
            at=(moment.begin,),
            other_run=moment.other_run,
            around=moment.body or None,
        )
        return _encode_picture(path, "svg+xml")


def _find_stable_run(data: ReportData) -> str | None:
    if data.tradeoff and data.tradeoff.recommendation:
        return data.tradeoff.recommendation.run_id
    rows = np.flatnonzero(~data.labels.failed)
    return data.store.columns.run_id(int(rows[0])) if len(rows) else None


class Moment(NamedTuple):
    """A moment of a run: a window of a body [s], its caption, and a run to show next to it."""

    run: str
    body: str
    begin: float
    end: float
    words: str
    other_run: str | None = None


def film_of_moment(store: Store, moment: Moment) -> Films:
    """Return a film in slow motion of the time around a moment, from near the body.

    If a film needs a package that is not installed, or OpenGL, the moment is drawn.
    """
    between = (
        max(moment.begin - FILM_RULES.before * FILM_RULES.shown_share, 0.0),
        moment.end + (1 - FILM_RULES.before) * FILM_RULES.shown_share,
    )
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "moment.gif"
            _load_viewer("gif")(
                store,
                moment.run,
                path,
                size=FILM_RULES.moment_size,
                camera=None,
                speed=(between[1] - between[0]) / FILM_RULES.moment_seconds,
                at=(),
                other_run=moment.other_run,
                between=between,
                around=moment.body,
            )
            return Films([HeaderFilm(moment.run, moment.words, _encode_picture(path, "gif"))])
    except (OutputError, SceneError) as error:
        try:
            drawing = _draw_moment(store, moment)
        except ContactlabError:
            return Films([], str(error))
        return Films([HeaderFilm(moment.run, moment.words, drawing, moves=False)])
    except ContactlabError as error:
        return Films([], str(error))


def _load_viewer(kind: str) -> Any:  # noqa: ANN401 - a function
    """Return the viewer that draws files of a kind; a ContactlabError names a missing package."""
    if find_spec("mujoco") is None:
        raise OutputError(f".{kind} needs mujoco, which is not installed; pip install mujoco")
    return find_extensions("viewer")[kind].load()


def film_in(file: Path, words: str) -> HeaderFilm | None:
    """Return a film of a file that was drawn before, .gif; None if it is too large for a page."""
    if file.stat().st_size > FILM_RULES.most_bytes:
        return None
    return HeaderFilm("", words, _encode_picture(file, "gif"))


def film_of(store: Store, run: str) -> Iterator[HeaderFilm]:
    """Yield the film of a run, unless it is too large for a page.

    A ContactlabError says why it cannot be drawn: it has no trace, or a package is not installed.
    """
    seconds = float(store.trace(store.record(run)).time[-1])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.gif"
        speed = min(max(seconds / FILM_RULES.seconds, 0.001), 1000.0)
        _load_viewer("gif")(store, run, path, size=FILM_RULES.size, camera=None, speed=speed, at=())
        size, source = path.stat().st_size, _encode_picture(path, "gif")
    if size <= FILM_RULES.most_bytes:
        yield HeaderFilm(run, store.record(run).label, source)
