"""A stored run as a file to look at; its suffix says which kind."""

from pathlib import Path

from contactlab.errors import optional
from contactlab.run.stored_runs import PreparedReplay, prepare_replay
from contactlab.store.finished_store import Store
from contactlab.store.mcap.stored_trace import StoredTrace
from contactlab.view.drawn_motion import BodyMotion, read_motion
from contactlab.view.picture_options import (
    FILMS,
    VIEWERS,
    PictureOptions,
    check_options,
    check_times,
)

# Frames per second of viewers' files, and of the steps that a sheet's arrows stand for.
_RATE = 60.0
_DEFAULT = PictureOptions()


def render(store: Store, run: str, target: Path, options: PictureOptions = _DEFAULT) -> BodyMotion:
    """Write a stored run as .mcap with a 3D layer, .rrd, .mp4, .gif or .png.

    Everything comes from the stored trace and scene; nothing is simulated again.

    Raises:
        OutputError: the suffix is unknown, an option does not apply to it, the file cannot be
            written, or a library is missing.
        StoreError: there is no such run, or its trace was not kept.
        SceneError: there is no OpenGL to draw with, or no such camera.
    """
    check_options(target, options)
    replay = prepare_replay(store, run)
    trace = store.trace(replay.record)
    check_times(options, trace.time)
    if target.suffix.lower() in VIEWERS:
        return _write_for_viewer(store, replay, trace, target)
    return _write_pictures(replay, trace, target, options)


def _write_for_viewer(
    store: Store, replay: PreparedReplay, trace: StoredTrace, target: Path
) -> BodyMotion:
    motion = read_motion(replay.prepared, trace, _RATE)
    if target.suffix.lower() == ".rrd":
        with optional("rerun", target.suffix):
            from contactlab.view.rerun_export import write_rrd  # noqa: PLC0415 - an extra
        write_rrd(target, trace, motion)
    else:
        with optional("view", f"{target.suffix} with a 3D layer"):
            from contactlab.view.foxglove_layer import write_with_layer  # noqa: PLC0415 - an extra
        assert replay.record.trace is not None, "its trace was read"
        with store.trace_file(replay.record.trace) as source:
            write_with_layer(source, target, motion)
    return motion


def _write_pictures(
    replay: PreparedReplay, trace: StoredTrace, target: Path, options: PictureOptions
) -> BodyMotion:
    with optional("view", target.suffix):
        from contactlab.view.film import RunPictures  # noqa: PLC0415 - an extra
    rate = FILMS.get(target.suffix.lower(), _RATE) / (options.speed or 1.0)
    motion = read_motion(replay.prepared, trace, rate, options.at)
    RunPictures(replay, motion, trace.qpos[motion.rows], options).write(target)
    return motion
