"""Writes a stored run as a file with the format of its suffix, or shows it in MuJoCo's viewer."""

import math
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from contactlab.errors import OutputError, SceneError, optional
from contactlab.run.stored_runs import PreparedReplay, prepare_replay
from contactlab.scene.initial_states import InitialStates, apply_inputs
from contactlab.store.finished_store import Store
from contactlab.store.mcap.trace_reader import StoredTrace
from contactlab.view.drawing import write_drawing
from contactlab.view.drawn_motion import (
    BodyMotion,
    Stage,
    arrow_scale,
    failing_pair,
    follow_body,
    nearest_indices,
    picture_times,
    read_motion,
    run_events,
    widen_stage,
)
from contactlab.view.drawn_shapes import body_poses
from contactlab.view.foxglove_files import layout_file

if TYPE_CHECKING:
    from contactlab.view.film import RunPictures

_VIEWER_SUFFIXES = (".mcap", ".rrd")
# Frames per second. A GIF has whole pictures, and delays in hundredths of a second.
_FILM_RATES = {".mp4": 30.0, ".gif": 12.5}
_SHEET_SUFFIXES = (".png", ".svg")


@dataclass(frozen=True)
class _PictureRules:
    """How densely pictures show a run."""

    frame_rate: float = 60.0  # of viewers' files, and of the steps that a sheet's arrows represent
    moments: int = 6  # of a sheet of one run: two rows
    moments_of_two: int = 3  # of each of two runs next to each other
    # Geoms in all pictures of a .gif: without a GPU, each takes about 10 us with its inset.
    most_geoms_of_gif: int = 250_000


_RULES = _PictureRules()


@dataclass(frozen=True)
class PictureOptions:
    """View of pictures: their width and height [pixels], and the camera of the model.

    Without a camera, the view shows the failing pair, and the whole motion as an inset. A film's
    speed is in simulated seconds per second. A sheet has pictures `at` times [s] or, without any,
    at starts of labels and peaks of forces. `other_run` names a run of the store to draw on the
    right. A film shows the motion `between` two times [s]; pictures follow the body `around`, if
    given.
    """

    size: tuple[int, int] | None = None
    camera: str | None = None
    speed: float | None = None
    at: tuple[float, ...] = ()
    other_run: str | None = None
    between: tuple[float, float] | None = None
    around: str | None = None


_DEFAULT_OPTIONS = PictureOptions()


def render_run(
    store: Store, run: str, target: Path, options: PictureOptions = _DEFAULT_OPTIONS
) -> BodyMotion:
    """Write a stored run as .mcap with a 3D layer, .rrd, .mp4, .gif, .png or .svg.

    Everything comes from the stored trace and scene; nothing is simulated again. An OutputError
    reports a wrong suffix, option, file or library, a StoreError that there is no such run or
    trace, a SceneError that there is no OpenGL to draw with, or no such camera.
    """
    _check_options(target, options)
    replay = prepare_replay(store, run)
    trace = store.trace(replay.record)
    start, end = trace.time[[0, -1]].tolist()
    if outside := [instant for instant in options.at if not start <= instant <= end]:
        raise OutputError(
            f"--at {outside[0]:g}: choose a time within the run, {start:g} to {end:g} s"
        )
    if target.suffix.lower() in _VIEWER_SUFFIXES:
        motion = read_motion(replay.prepared_model, trace, _RULES.frame_rate)
        events = run_events(replay.record.labels, trace.time[: motion.rows[-1] + 1])
        if target.suffix.lower() == ".rrd":
            with optional("rerun", target.suffix):
                from contactlab.view.rerun_export import write_rrd  # noqa: PLC0415 - an extra
            write_rrd(target, trace, motion, events)
        else:
            with optional("view", f"{target.suffix} with a 3D layer"):
                from contactlab.view.foxglove_layer import write_with_layer  # noqa: PLC0415 - an extra
            assert replay.record.trace is not None, "its trace was read"
            with store.trace_file(replay.record.trace) as source:
                write_with_layer(source, target, motion, events)
        return motion
    runs = [(replay, trace)]
    if options.other_run is not None:
        other = prepare_replay(store, options.other_run)
        runs.append((other, store.trace(other.record)))
    return _write_pictures(runs, target, options)


def write_file(  # noqa: PLR0913 - one argument an option
    store: Store,
    run: str,
    target: Path,
    *,
    size: tuple[int, int] | None,
    camera: str | None,
    speed: float | None,
    at: Sequence[float],
    other_run: str | None = None,
    between: tuple[float, float] | None = None,
    around: str | None = None,
) -> str | None:
    """Write a run like `render`; return the meaning of its arrows and the other written files."""
    options = PictureOptions(size, camera, speed, tuple(at), other_run, between, around)
    motion = render_run(store, run, target, options)
    notes: list[str] = []
    if len(motion.forces.frame):
        notes.append(
            f"an arrow is the force on the second side of a pair: {motion.scale:g} m long for 1 N, "
            f"at most {motion.longest:.3g} m"
        )
    if target.suffix.lower() == ".mcap":
        notes.append(f"{layout_file(target)} is a layout that shows it")
    return "; ".join(notes) or None


def _write_pictures(
    runs: Sequence[tuple[PreparedReplay, StoredTrace]], target: Path, options: PictureOptions
) -> BodyMotion:
    """Write a film or a sheet of one run, or of two with the same view."""
    suffix = target.suffix.lower()
    if suffix == ".svg":
        return _draw_moments(runs, target, options)
    with optional("view", target.suffix):
        from contactlab.view.film import (  # noqa: PLC0415 - an extra
            side_by_side,
            write_gif,
            write_mp4,
            write_sheet,
        )
    rate = _FILM_RATES.get(suffix, _RULES.frame_rate) / (options.speed or 1.0)
    is_sheet = suffix in _SHEET_SUFFIXES
    most = _RULES.moments if len(runs) == 1 else _RULES.moments_of_two
    moments = {time for run in runs for time in _sheet_times(*run, most)} if is_sheet else ()
    times = options.at or sorted(moments)
    pictures = [_run_pictures(*run, rate, times, options) for run in runs]
    if len(pictures) > 1:
        motions = _share_view([picture.motion for picture in pictures])
        pictures = [
            replace(picture, motion=motion)
            for picture, motion in zip(pictures, motions, strict=True)
        ]
    if is_sheet:
        sheets = [iter(picture.draw_sheet(times)) for picture in pictures]
        if len(sheets) > 1:
            write_sheet(target, [*side_by_side(*sheets)], most=1)
        else:
            write_sheet(target, [*sheets[0]])
    else:
        if suffix == ".gif":
            # 256 colors hardly show smoothed edges, which take half of the time without a GPU.
            for picture in pictures:
                picture.replay.prepared_model.model.vis.quality.offsamples = 0
        most_geoms = _RULES.most_geoms_of_gif if suffix == ".gif" else math.inf
        films = [picture.draw_film(rate, most_geoms) for picture in pictures]
        write_film = write_mp4 if suffix == ".mp4" else write_gif
        write_film(
            target, side_by_side(*films) if len(films) > 1 else films[0], _FILM_RATES[suffix]
        )
    return pictures[0].motion


def _draw_moments(
    runs: Sequence[tuple[PreparedReplay, StoredTrace]], target: Path, options: PictureOptions
) -> BodyMotion:
    if options.camera is not None:
        raise OutputError("--camera is for films and .png; leave it out for .svg")
    most = 1 if len(runs) > 1 else _RULES.moments_of_two
    times = options.at or sorted({time for run in runs for time in _sheet_times(*run, most)})
    motions = [
        _follow_pair(
            read_motion(replay.prepared_model, trace, _RULES.frame_rate, times),
            replay,
            trace,
            options,
        )
        for replay, trace in runs
    ]
    if len(motions) > 1:
        motions = _share_view(motions)
    moments = [
        (motion, frame, f"{motion.time[frame]:.3f} s  {run.record.run_id[:8]}: {run.record.label}")
        for time in times
        for motion, (run, _) in zip(motions, runs, strict=True)
        for frame in nearest_indices(motion.time, np.array([time])).tolist()
    ]
    write_drawing(target, moments, options.size or (480, 360))
    return motions[0]


def _share_view(motions: Sequence[BodyMotion]) -> list[BodyMotion]:
    # One view includes all motions, and arrows have one scale.
    low = np.min([motion.centre - motion.radius for motion in motions], axis=0)
    high = np.max([motion.centre + motion.radius for motion in motions], axis=0)
    centre = (low + high) / 2
    radius = max(
        float(np.linalg.norm(motion.centre - centre)) + motion.radius for motion in motions
    )
    scale, longest = arrow_scale(
        np.concatenate([motion.forces.force for motion in motions]), radius
    )
    stage = Stage(centre, radius)
    return [
        replace(motion, stage=stage, scale=scale, longest=longest, followed=None)
        for motion in motions
    ]


def _sheet_times(replay: PreparedReplay, trace: StoredTrace, most: int) -> list[float]:
    motion = read_motion(replay.prepared_model, trace, _RULES.frame_rate)
    events = run_events(replay.record.labels, trace.time[: motion.rows[-1] + 1])
    return picture_times(motion, trace, events, failing_pair(replay.record, trace.pairs), most)


def _run_pictures(
    replay: PreparedReplay,
    trace: StoredTrace,
    rate: float,
    times: Sequence[float],
    options: PictureOptions,
) -> "RunPictures":
    from contactlab.view.film import RunPictures, recorded_poses  # noqa: PLC0415 - an extra

    motion, model = (
        read_motion(replay.prepared_model, trace, rate, times),
        replay.prepared_model.model,
    )
    qpos = trace.qpos[motion.rows]
    recorded = recorded_poses(replay.runs.scene.recorded_motion(replay.runs.resolved), motion.time)
    if recorded:
        ghosts = np.stack([recorded[frame] for frame in range(len(qpos))])
        motion = widen_stage(motion, *body_poses(model, np.where(np.isnan(ghosts), qpos, ghosts)))
    if options.camera is None and not recorded:
        motion = _follow_pair(motion, replay, trace, options)
    begins = [(label.step, label.label) for label in replay.record.labels if label.step is not None]
    labels_by_row = {
        int(np.searchsorted(motion.rows, step)): label for step, label in reversed(begins)
    }
    size = options.size or (640, 480)
    between = options.between or (-math.inf, math.inf)
    return RunPictures(replay, motion, qpos, size, options.camera, recorded, labels_by_row, between)


def _follow_pair(
    motion: BodyMotion, replay: PreparedReplay, trace: StoredTrace, options: PictureOptions
) -> BodyMotion:
    if options.around is not None:
        bodies = [body for body, name in enumerate(motion.bodies) if name == options.around]
    else:
        name, geom_bodies = (
            failing_pair(replay.record, trace.pairs),
            replay.prepared_model.model.geom_bodyid,
        )
        pairs = [pair for pair in replay.runs.base.pairs if pair.name == name]
        bodies = [int(geom_bodies[geoms[0]]) for pair in pairs for geoms in pair.geoms]
    return (follow_body(motion, bodies) if bodies else None) or motion


def _check_options(target: Path, options: PictureOptions) -> None:
    suffix = target.suffix.lower()
    suffixes = (*_VIEWER_SUFFIXES, *_FILM_RATES, *_SHEET_SUFFIXES)
    if suffix not in suffixes:
        raise OutputError(f"cannot write {target}: end its name in {', '.join(suffixes)}")
    if not target.parent.is_dir():
        raise OutputError(f"cannot write {target}: there is no folder {target.parent}")
    if options.at and suffix not in _SHEET_SUFFIXES:
        suffixes = " and ".join(_SHEET_SUFFIXES)
        raise OutputError(f"--at is for {suffixes} only; leave it out for {suffix}")
    if options.speed is not None and suffix not in _FILM_RATES:
        raise OutputError(
            f"--speed is for {' and '.join(_FILM_RATES)} only; leave it out for {suffix}"
        )
    if suffix in _VIEWER_SUFFIXES and (options.size or options.camera or options.other_run):
        names = "--size, --camera and --side-by-side"
        raise OutputError(f"{names} are for pictures; leave them out for {suffix}")
    low, high = 64, 4096
    if options.size and any(side % 2 or not low <= side <= high for side in options.size):
        raise OutputError(f"--size takes even numbers from {low} to {high}, as in 640x480")
    slowest, fastest = 0.001, 1000.0
    if options.speed is not None and not slowest <= options.speed <= fastest:
        raise OutputError(f"--speed takes {slowest:g} to {fastest:g}; 0.1 is slow motion")


def open_viewer(model: mujoco.MjModel, start: InitialStates) -> None:
    """Simulate from an initial state in MuJoCo's viewer, in real time, until it is closed.

    A SceneError says that there is no display.
    """
    import glfw  # noqa: PLC0415 - it looks for a display

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        # Without a display, MuJoCo's viewer would end the process.
        has_display = bool(glfw.init())
    if not has_display:
        raise SceneError("no display for the viewer; replay without --view")
    import mujoco.viewer  # noqa: PLC0415 - it looks for a display

    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = start.qpos[0], start.qvel[0], start.ctrl[0]
    data.xfrc_applied[:] = start.applied[0].reshape(-1, 6)
    data.act[:] = start.act[0]
    try:
        window = mujoco.viewer.launch_passive(model, data)
    except (RuntimeError, OSError) as error:
        raise SceneError(f"no viewer: {error}; replay without --view checks the run") from error
    with window:
        while window.is_running():
            tick = time.perf_counter()
            # Set the inputs that change over time; the user sets the others.
            step = np.array([round(data.time / model.opt.timestep)])
            inputs = start.input_rows(0, model.opt.timestep, step)[0]
            own = np.concatenate(
                [
                    part.ravel()
                    for part in (data.ctrl, data.xfrc_applied, data.mocap_pos, data.mocap_quat)
                ]
            )
            own[start.driven_inputs] = inputs[start.driven_inputs]
            apply_inputs(model, data, own)
            mujoco.mj_step(model, data)
            window.sync()
            time.sleep(max(0.0, model.opt.timestep - (time.perf_counter() - tick)))
