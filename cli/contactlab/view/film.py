"""Draws a run as a film or a sheet of pictures, by MuJoCo's renderer without a display."""

import ctypes.util
import importlib
import itertools
import math
import os
from collections import Counter
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain, repeat, zip_longest
from pathlib import Path
from types import MappingProxyType
from typing import Protocol

import av
import mujoco
import numpy as np
from av.video.stream import VideoStream
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from contactlab.contact.trace_arrays import Floats
from contactlab.contact.trace_setup import RecordedMotion
from contactlab.errors import SceneError, did_you_mean
from contactlab.numerical_tolerance import SUM_ROUNDING
from contactlab.palette import MODE_COLOURS
from contactlab.rendering.amounts import format_amount
from contactlab.run.stored_runs import PreparedReplay
from contactlab.step_progress import count_steps
from contactlab.store.atomic_files import atomic_write
from contactlab.view.drawn_motion import BodyMotion, Stage, frame_times, nearest_indices
from contactlab.view.drawn_shapes import VISIBLE_GROUPS, drawn_geoms

Picture = NDArray[np.uint8]

_ARROW = mujoco.mjtGeom.mjGEOM_ARROW
_PLACEMENT_STAGES = (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_camlight, mujoco.mj_tendon)
# The values of MUJOCO_GL, each with its system library.
_BACKEND_LIBRARIES = {"egl": "EGL", "osmesa": "OSMesa", "glfw": "glfw"}
_OPENGL_REMEDY = (
    "install EGL or OSMesa (Debian: apt install libegl1 libgl1-mesa-dri, or libosmesa6) and choose "
    "with MUJOCO_GL=egl or MUJOCO_GL=osmesa; .mcap and .rrd files need neither"
)
# Half the size of the encoder's default, without a visible difference.
_H264_OPTIONS = {"crf": "20"}


@dataclass(frozen=True)
class _FilmLook:
    """Sizes and colors of arrows, captions and insets."""

    arrow_radius: float = 0.015  # of the radius of the view's sphere
    most_arrow_share: float = 0.1  # of the length of the arrow: a short one stays slender
    paper: tuple[int, int, int] = (255, 255, 255)
    ink: tuple[int, int, int] = (40, 44, 52)
    border: int = 6  # around captions and insets [pixels]


_LOOK = _FilmLook()


class _Screen(Protocol):
    """An off-screen OpenGL context of MuJoCo's."""

    def make_current(self) -> None: ...
    def free(self) -> None: ...


@contextmanager
def graphics_context(width: int, height: int) -> Generator[_Screen]:
    """Make an off-screen OpenGL context of this size current; raise a SceneError without OpenGL."""
    requested = os.environ.get("MUJOCO_GL", "").lower()
    installed = [
        name for name in ("egl", "osmesa") if ctypes.util.find_library(_BACKEND_LIBRARIES[name])
    ]
    backends = [requested] if requested in _BACKEND_LIBRARIES else installed
    if not backends:
        raise SceneError(f"no pictures: there is no OpenGL to draw with; {_OPENGL_REMEDY}")
    name = backends[0]
    try:
        screen: _Screen = importlib.import_module(f"mujoco.{name}").GLContext(width, height)
        screen.make_current()
    except Exception as error:
        raise SceneError(
            f"no pictures: {name} does not work here ({error}); {_OPENGL_REMEDY}"
        ) from error
    try:
        yield screen
    finally:
        screen.free()


def draw_pictures(
    model: mujoco.MjModel,
    motion: BodyMotion,
    frames: Mapping[int, Floats],
    size: tuple[int, int],
    camera: str | None = None,
    recorded: Mapping[int, Floats] = MappingProxyType({}),
) -> Generator[Picture]:
    """Yield a picture (height, width, 3) of some frames of a motion, by configuration (nq,).

    `recorded` configurations (nq,), with NaN for other bodies, are drawn as a ghost in addition.
    The model's off-screen buffer is set to the size, width and height [pixels]. Without the name of
    one of its cameras, the view shows the whole motion, or the body that it follows with the whole
    as an inset. A SceneError says that there is no OpenGL, no camera of this name, or nothing to
    draw.
    """
    if not model.ngeom + model.ntendon + model.nflex + model.nskin:
        raise SceneError("no pictures: no body of the model has a geom; add geoms to moving bodies")
    width, height = size
    set_looks(model, size)
    named = None if camera is None else _model_camera(model, camera)
    areas = [mujoco.MjrRect(0, 0, width, height)]
    if named is None and motion.followed is not None:
        inset_factor = 4  # size of the picture over that of the inset
        areas.append(mujoco.MjrRect(0, 0, width // inset_factor, height // inset_factor))
    option = mujoco.MjvOption()
    option.flags[mujoco.mjtVisFlag.mjVIS_TRANSPARENT] = True
    # Each geom may be drawn twice; the others are sites, tendons, trails and forces.
    data, scene = mujoco.MjData(model), mujoco.MjvScene(model, 20_000 + 2 * model.ngeom)
    with graphics_context(width, height) as screen:
        context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        try:
            for frame, configuration in frames.items():
                pictures: list[Picture] = []
                for stage, area in zip((motion.view(frame), motion.stage), areas, strict=False):
                    view = named or _stage_camera(model, stage, width / height)
                    # Contacts are stored, so everything is placed without collision detection.
                    data.qpos[:] = configuration
                    _place_objects(model, data)
                    everything = mujoco.mjtCatBit.mjCAT_ALL.value
                    mujoco.mjv_updateScene(model, data, option, None, view, everything, scene)
                    draw_background(model, scene)
                    _draw_trail(scene, motion, frame)
                    _draw_forces(scene, motion, frame)
                    if frame in recorded:
                        _draw_ghost(scene, model, data, recorded[frame], option)
                    # Another film may have been drawn in the meantime.
                    screen.make_current()
                    picture = np.empty((area.height, area.width, 3), np.uint8)
                    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, context)
                    mujoco.mjr_render(area, scene, context)
                    mujoco.mjr_readPixels(picture, None, area, context)
                    pictures.append(picture[::-1])
                # The second picture is an inset of the first one, in a frame at its top right.
                final_picture = pictures[0].copy()
                for inset in pictures[1:]:
                    right = width - _LOOK.border
                    rows = slice(_LOOK.border, _LOOK.border + inset.shape[0])
                    framed = final_picture[rows, right - inset.shape[1] : right]
                    framed[:] = inset
                    for edge in (framed[:2], framed[-2:], framed[:, :2], framed[:, -2:]):
                        edge[:] = _LOOK.paper
                yield final_picture
        finally:
            # Objects of a context are deleted by number, in the current context.
            screen.make_current()
            context.free()


def set_looks(model: mujoco.MjModel, size: tuple[int, int]) -> None:
    """Prepare a model for pictures of a size: bright, with translucent moving bodies.

    Geoms that are drawn get a group that MuJoCo's renderer shows.
    """
    hidden = drawn_geoms(model) & (model.geom_group >= VISIBLE_GROUPS)
    model.geom_group[hidden] = VISIBLE_GROUPS - 1
    model.vis.global_.offwidth, model.vis.global_.offheight = size
    # A texel of the map of shadows per pixel: with three, software takes twice the time.
    model.vis.quality.shadowsize = min(2048, max(size))
    meshes = model.geom_dataid[model.geom_type == mujoco.mjtGeom.mjGEOM_MESH]
    # With more triangles, shadows and several samples per pixel take 90 % of software's time.
    most_shaded_triangles = 50_000
    if model.mesh_facenum[meshes].sum() > most_shaded_triangles:
        model.light_castshadow[:], model.vis.quality.offsamples = 0, 0
    body_opacity = 0.45
    # Arrows must be visible.
    model.vis.map.alpha = body_opacity
    ambient_light = 0.35
    model.vis.headlight.ambient[:] = np.maximum(model.vis.headlight.ambient, ambient_light)


def _draw_trail(scene: mujoco.MjvScene, motion: BodyMotion, frame: int) -> None:
    """Add the path of the followed body up to a frame; older parts are fainter."""
    body = int(np.argmax(motion.moving)) if motion.followed is None else motion.followed
    max_trail_pieces, trail_colour = 60, (0.10, 0.27, 0.98)  # red, green and blue
    rows = np.unique(np.linspace(0, frame, min(frame + 1, max_trail_pieces)).astype(int))
    way, radius = motion.positions[rows, body], _LOOK.arrow_radius * motion.view(frame).radius
    for place, (begin, end) in enumerate(itertools.pairwise(way), 1):
        if scene.ngeom < scene.maxgeom and np.linalg.norm(end - begin) > radius:
            colour = (*trail_colour, place / len(way))
            geom = _new_geom(scene, mujoco.mjtGeom.mjGEOM_CAPSULE, colour)
            mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_CAPSULE.value, radius, begin, end)


def _place_objects(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    for place in _PLACEMENT_STAGES:
        place(model, data)


def _draw_ghost(
    scene: mujoco.MjvScene,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    recorded: Floats,
    option: mujoco.MjvOption,
) -> None:
    """Add the geoms that a recorded configuration (nq,) places elsewhere; NaN if not recorded."""
    before, first = data.geom_xpos.copy(), scene.ngeom
    turned = data.geom_xmat.copy()
    data.qpos[:] = np.where(np.isnan(recorded), data.qpos, recorded)
    _place_objects(model, data)
    moved = (data.geom_xpos != before).any(axis=1) | (data.geom_xmat != turned).any(axis=1)
    moving = mujoco.mjtCatBit.mjCAT_DYNAMIC.value
    mujoco.mjv_addGeoms(model, data, option, mujoco.MjvPerturb(), moving, scene)
    ghost_colour = (0.95, 0.45, 0.1, 0.35)  # color of recorded motion
    for geom in scene.geoms[first : scene.ngeom]:
        is_geom = geom.objtype == mujoco.mjtObj.mjOBJ_GEOM.value
        geom.rgba[:] = ghost_colour if is_geom and moved[geom.objid] else 0


def draw_background(model: mujoco.MjModel, scene: mujoco.MjvScene) -> None:
    """Put a bright wall behind everything if a model has no sky, instead of MuJoCo's black."""
    has_sky = (model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX).any()
    if has_sky or scene.ngeom == scene.maxgeom:
        return
    eye = scene.camera[0]
    # The background's distance as a fraction of the farthest visible one.
    wall_distance = 0.5
    far = wall_distance * eye.frustum_far
    half = 2 * far / eye.frustum_near * max(eye.frustum_top, eye.frustum_width, eye.frustum_near)
    up, back = eye.up.astype(float), -eye.forward.astype(float)
    turn = np.stack([np.cross(up, back), up, back], axis=1)
    background_colour = (0.74, 0.79, 0.86, 1.0)
    wall = _new_geom(scene, mujoco.mjtGeom.mjGEOM_BOX, background_colour)
    wall.pos, wall.size, wall.mat = eye.pos + far * eye.forward, (half, half, far * 1e-3), turn
    wall.emission, wall.specular, wall.reflectance = 0.2, 0.0, 0.0


def _model_camera(model: mujoco.MjModel, name: str) -> mujoco.MjvCamera:
    names = [model.camera(index).name for index in range(model.ncam)]
    if name not in names:
        known = f"; it has {', '.join(names)}" if names else "; leave --camera out"
        raise SceneError(f"the model has no camera '{name}'{did_you_mean(name, names)}{known}")
    camera = mujoco.MjvCamera()
    camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, names.index(name)
    return camera


def _stage_camera(model: mujoco.MjModel, stage: Stage, aspect: float) -> mujoco.MjvCamera:
    camera = mujoco.MjvCamera()
    camera.lookat[:] = stage.centre
    camera.distance = _camera_distance(model, stage, aspect)
    camera.azimuth, camera.elevation = 120.0, -18.0
    return camera


def _camera_distance(model: mujoco.MjModel, stage: Stage, aspect: float) -> float:
    """Return the distance of a camera that sees all of a stage from its center [m]."""
    half = math.radians(float(model.vis.global_.fovy)) / 2
    narrow = min(half, math.atan(math.tan(half) * aspect))
    distance_margin = 1.05
    return distance_margin * stage.radius / math.sin(narrow)


def force_bar(
    model: mujoco.MjModel, stage: Stage, size: tuple[int, int], scale: float
) -> tuple[float, int]:
    """Return a round force [N], and the length of its arrow at a stage's center [pixels].

    The arrow has a scale [m/N] and is perpendicular to the view.
    """
    width, height = size
    half = math.radians(float(model.vis.global_.fovy)) / 2
    across = 2 * math.tan(half) * _camera_distance(model, stage, width / height)
    pixels = height / across * scale
    max_bar_share = 0.2  # of the width
    most = max_bar_share * width / pixels
    decade = 10.0 ** math.floor(math.log10(most))
    force = max(
        digit * decade for digit in (1, 2, 5) if digit * decade <= most * (1 + SUM_ROUNDING)
    )
    return force, round(force * pixels)


def _draw_forces(scene: mujoco.MjvScene, motion: BodyMotion, frame: int) -> None:
    chosen = motion.forces.of(frame)
    points, arrows = motion.forces.position[chosen], motion.arrows[chosen]
    modes = motion.forces.mode[chosen].tolist()
    for point, arrow, mode in zip(points, arrows, modes, strict=True):
        if scene.ngeom == scene.maxgeom:
            return
        width = min(
            _LOOK.arrow_radius * motion.view(frame).radius,
            _LOOK.most_arrow_share * float(np.linalg.norm(arrow)),
        )
        geom = _new_geom(scene, _ARROW, MODE_COLOURS[mode])
        # MuJoCo draws an arrow at half its length.
        mujoco.mjv_connector(geom, _ARROW.value, width, point, point + 2 * arrow)


def _new_geom(
    scene: mujoco.MjvScene, kind: mujoco.mjtGeom, colour: tuple[float, ...]
) -> mujoco.MjvGeom:
    geom, rgba = scene.geoms[scene.ngeom], np.array(colour, np.float32)
    mujoco.mjv_initGeom(geom, kind.value, np.zeros(3), np.zeros(3), np.eye(3).ravel(), rgba)
    # mjv_initGeom does not set the category; old memory would decide about a shadow of the geom.
    geom.category = mujoco.mjtCatBit.mjCAT_DECOR.value
    scene.ngeom += 1
    return geom


@dataclass(frozen=True)
class RunPictures:
    """The pictures of a run, drawn when they are written; qpos is (F, nq), of the frames.

    The camera is one of the model, or the motion's own; `said` are words for frames. A film shows
    the motion between two times.
    """

    replay: PreparedReplay
    motion: BodyMotion
    qpos: Floats
    size: tuple[int, int]
    camera: str | None
    recorded: Mapping[int, Floats]
    captions: Mapping[int, str]
    between: tuple[float, float] = (-math.inf, math.inf)  # time range of a film [s]

    def draw_film(self, rate: float, most_geoms: float = math.inf) -> Iterator[Picture]:
        """Yield a film's pictures, `rate` per simulated second.

        Each is shown several times if all pictures together would draw too many geoms.
        """
        time, geoms = self.motion.time, self.replay.prepared_model.model.ngeom
        times, (begin, end) = frame_times(time, rate), self.between
        times = times[(times >= begin) & (times <= end)]
        shown = np.arange(len(times))
        shown -= shown % max(1, math.ceil(len(times) * geoms / most_geoms))
        counts = Counter(nearest_indices(time, times[shown]).tolist())
        for count, picture in zip(counts.values(), self._draw_frames(list(counts)), strict=True):
            yield from repeat(picture, count)

    def draw_sheet(self, times: Sequence[float]) -> list[Picture]:
        """Return a sheet's pictures, at times [s]."""
        wanted: list[int] = nearest_indices(self.motion.time, np.array(times)).tolist()
        frames = sorted(set(wanted))
        drawn = dict(zip(frames, self._draw_frames(frames), strict=True))
        return [drawn[frame] for frame in wanted]

    def _draw_frames(self, frames: Sequence[int]) -> Iterator[Picture]:
        record, model, motion = self.replay.record, self.replay.prepared_model.model, self.motion
        chosen = {frame: self.qpos[frame] for frame in frames}
        outcomes = [] if record.success is None else ["success" if record.success else "no success"]
        # An episode's success says more than `stable`, but a failed contact is added to it.
        outcomes += [] if outcomes and record.label == "stable" else [record.label]
        run = f"{record.scene} {record.run_id[:8]}: {', '.join(outcomes)}"
        bar = None
        if len(motion.forces.frame) and self.camera is None:
            bar = force_bar(model, motion.view(0), self.size, motion.scale)
        drawn = draw_pictures(model, motion, chosen, self.size, self.camera, self.recorded)
        pairs = zip(frames, drawn, strict=True)
        for frame, picture in count_steps(pairs, "pictures", len(frames)):
            caption = [f"begins: {self.captions[frame]}"] if frame in self.captions else []
            yield add_caption(picture, [f"{motion.time[frame]:.3f} s", *caption, run], bar)


def side_by_side(first: Iterator[Picture], second: Iterator[Picture]) -> Iterator[Picture]:
    """Yield pairs of pictures of one size, left and right; the shorter film keeps its last."""
    left = right = np.empty(0, np.uint8)
    for one, other in zip_longest(first, second):
        left, right = (left if one is None else one), (right if other is None else other)
        yield np.concatenate([left, right], axis=1)


def recorded_poses(motion: RecordedMotion | None, times: Floats) -> dict[int, Floats]:
    """Return recorded configurations (nq,) of a run nearest to some times (F,) [s], by index."""
    if motion is None:
        return {}
    rows: list[int] = nearest_indices(motion.times[0][np.isfinite(motion.times[0])], times).tolist()
    return {frame: motion.qpos[0, row] for frame, row in enumerate(rows)}


def write_mp4(target: Path, pictures: Iterator[Picture], rate: float) -> None:
    """Write pictures of one even size as H.264 video, `rate` per second."""
    with atomic_write(target) as temporary, av.open(str(temporary), "w", format="mp4") as container:
        stream: VideoStream = container.add_stream(
            "libx264", rate=round(rate), options=_H264_OPTIONS
        )
        first = next(pictures)
        stream.height, stream.width = first.shape[:2]
        stream.pix_fmt = "yuv420p"
        for picture in chain([first], pictures):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())


def write_gif(target: Path, pictures: Iterator[Picture], rate: float) -> None:
    """Write pictures as an endless animation, `rate` per second."""
    # Colors are reduced here by an octree. Pillow's own way, by medians, takes 2.5 times as long,
    # and its files are a fifth larger.
    images = (
        Image.fromarray(picture).quantize(
            method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE
        )
        for picture in pictures
    )
    with atomic_write(target) as temporary:
        animation = {
            "save_all": True,
            "append_images": images,
            "duration": round(1000 / rate),
            "loop": 0,
        }
        next(images).save(temporary, format="GIF", **animation)


def add_caption(
    picture: Picture, words: Sequence[str], bar: tuple[float, int] | None = None
) -> Picture:
    """Return a picture with a line of words below it; its height is even, as H.264 requires.

    The line has as many of the words, from the first, as there is room for. A bar of a number of
    pixels shows the length of the arrow of a force [N].
    """
    height, width, _ = picture.shape
    size = max(10, width // 40)
    strip = size + 2 * _LOOK.border
    image = Image.new("RGB", (width, (height + strip + 1) // 2 * 2), _LOOK.paper)
    image.paste(Image.fromarray(picture))
    top, middle, right = height + _LOOK.border // 2, height + strip // 2, width - _LOOK.border
    pen, font = ImageDraw.Draw(image), ImageFont.load_default(size)
    if bar is not None:
        force, pixels = bar
        label, left = format_amount(force, "N"), right - pixels
        pen.line((left, middle, right, middle), _LOOK.ink, 2)
        for end in (left, right):
            pen.line((end, middle - size // 3, end, middle + size // 3), _LOOK.ink, 2)
        right = left - _LOOK.border - math.ceil(pen.textlength(label, font))
        pen.text((right, top), label, _LOOK.ink, font)
    lines = ["   ".join(words[: len(words) - left_out]) for left_out in range(len(words))]
    fitting = (line for line in lines if pen.textlength(line, font) < right - 3 * _LOOK.border)
    pen.text((_LOOK.border, top), next(fitting, words[0]), _LOOK.ink, font)
    return np.asarray(image)


def write_sheet(target: Path, pictures: Sequence[Picture], most: int = 3) -> None:
    """Write pictures of one size as one PNG, row by row, with at most `most` in a row."""
    columns = min(len(pictures), most)
    rows = math.ceil(len(pictures) / columns)
    height, width, _ = pictures[0].shape
    sheet = Image.new("RGB", (columns * width, rows * height), _LOOK.paper)
    for index, picture in enumerate(pictures):
        row, column = divmod(index, columns)
        sheet.paste(Image.fromarray(picture), (column * width, row * height))
    with atomic_write(target) as temporary:
        sheet.save(temporary, format="PNG")
