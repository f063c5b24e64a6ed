"""A stored run as a file to look at; its suffix says which kind."""

from pathlib import Path

from contactlab.errors import optional
from contactlab.run.stored_runs import PreparedReplay, prepare_replay
from contactlab.store import Store
from contactlab.store.mcap import StoredTrace
from contactlab.view.animation import BodyMotion
from contactlab.view.drawn_motion import read_motion
from contactlab.view.picture_options import (
    FILMS,
    VIEWERS,
    PictureOptions,
    check_options,
    check_times,
)
from contactlab.view.viewer_export import export_mcap, export_rrd

# As often as screens show pictures; fine enough for a sheet's arrows too.
_RATE = 60.0


def render(store: Store, run: str, target: Path, look: PictureOptions | None = None) -> BodyMotion:
    """Write a stored run as .mcap with a 3D layer, .rrd, .mp4, .gif or .png.

    Everything comes from the stored trace and scene; nothing is simulated again.

    Args:
        store: the store.
        run: the run's id, or the start of it.
        target: the file to make or replace.
        look: how pictures are taken.

    Returns:
        What was drawn.

    Raises:
        OutputError: the file has another suffix or cannot be written, an option does not fit it,
            or what writes it is not installed.
        StoreError: no such run, or no trace of it was kept.
        SceneError: there is no OpenGL to draw pictures with, or no such camera.
    """
    look = look or PictureOptions()
    check_options(target, look)
    start = prepare_replay(store, run)
    trace = store.trace(start.record)
    check_times(look, trace.time)
    if target.suffix.lower() in VIEWERS:
        return _export(store, start, trace, target)
    return _draw(start, trace, target, look)


def _export(store: Store, start: PreparedReplay, trace: StoredTrace, target: Path) -> BodyMotion:
    motion = read_motion(start.prepared, trace, _RATE)
    if target.suffix.lower() == ".rrd":
        export_rrd(target, trace, motion)
    else:
        assert start.record.trace is not None, "its trace was read"
        with store.trace_file(start.record.trace) as source:
            export_mcap(source, target, motion)
    return motion


def _draw(
    start: PreparedReplay, trace: StoredTrace, target: Path, look: PictureOptions
) -> BodyMotion:
    with optional("view", target.suffix):
        from contactlab.view.film import RunPictures  # noqa: PLC0415 - an extra
    rate = FILMS.get(target.suffix.lower(), _RATE) / (look.speed or 1.0)
    motion = read_motion(start.prepared, trace, rate, look.at)
    RunPictures(start, motion, trace.qpos[motion.rows], look).write(target)
    return motion
