"""Pictures that MuJoCo draws, without a display, from stored poses and contact forces."""

import ctypes.util
import importlib
import math
import os
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats
from contactlab.errors import SceneError, did_you_mean
from contactlab.palette import MODE_COLOURS
from contactlab.view.drawn_motion import BodyMotion

Picture = NDArray[np.uint8]

_AZIMUTH, _ELEVATION = 120.0, -18.0
_MARGIN = 1.05
_MOST_GEOMS = 20_000
# An arrow's radius as a fraction of the sphere's, and at most of its own length.
_RADIUS, _MOST_RADIUS = 0.015, 0.1
_SOLID = 0.45
_AMBIENT = 0.35
_SHADOW = 2048
_BACKGROUND = (0.74, 0.79, 0.86, 1.0)
# The background's distance as a fraction of the farthest visible one.
_WALL = 0.5
_ARROW = mujoco.mjtGeom.mjGEOM_ARROW
# The values of MUJOCO_GL, each with its system library.
_BACKENDS = {"egl": "EGL", "osmesa": "OSMesa", "glfw": "glfw"}
_REMEDY = (
    "install EGL or OSMesa (Debian: apt install libegl1 libgl1-mesa-dri, or libosmesa6) and choose "
    "with MUJOCO_GL=egl or MUJOCO_GL=osmesa; .mcap and .rrd files need neither"
)


@contextmanager
def graphics(width: int, height: int) -> Generator[None]:
    """Make an off-screen OpenGL context of this size the current one.

    Raises:
        SceneError: there is no OpenGL to draw with.
    """
    name = _backend()
    try:
        context = importlib.import_module(f"mujoco.{name}").GLContext(width, height)
        context.make_current()
    except Exception as error:
        raise SceneError(f"no pictures: {name} does not work here ({error}); {_REMEDY}") from error
    try:
        yield
    finally:
        context.free()


def _backend() -> str:
    asked = os.environ.get("MUJOCO_GL", "").lower()
    if asked in _BACKENDS:
        return asked
    found = [name for name in ("egl", "osmesa") if ctypes.util.find_library(_BACKENDS[name])]
    if not found:
        raise SceneError(f"no pictures: there is no OpenGL to draw with; {_REMEDY}")
    return found[0]


def draw_pictures(
    model: mujoco.MjModel,
    motion: BodyMotion,
    frames: Mapping[int, Floats],
    size: tuple[int, int],
    camera: str | None = None,
) -> Iterator[Picture]:
    """Yield a picture (height, width, 3) of some frames of a motion, by configuration (nq,).

    The model's off-screen buffer is set to the size, width and height [pixels]. Without the name
    of one of its cameras, one sees the whole motion.

    Raises:
        SceneError: there is no OpenGL, or no camera of this name.
    """
    width, height = size
    _set_appearance(model, width, height)
    view = _camera(model, motion, width / height, camera)
    option = mujoco.MjvOption()
    option.flags[mujoco.mjtVisFlag.mjVIS_TRANSPARENT] = True
    has_sky = bool((model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX).any())
    data, scene = mujoco.MjData(model), mujoco.MjvScene(model, _MOST_GEOMS)
    with graphics(width, height):
        context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, context)
        for frame, configuration in frames.items():
            _pose(model, data, configuration)
            everything = mujoco.mjtCatBit.mjCAT_ALL.value
            mujoco.mjv_updateScene(model, data, option, None, view, everything, scene)
            if not has_sky:
                _draw_background(scene)
            _draw_forces(scene, motion, frame)
            yield _shot(scene, context, width, height)
        context.free()


def _pose(model: mujoco.MjModel, data: mujoco.MjData, configuration: Floats) -> None:
    """Place everything that is drawn, without collision detection: contacts were stored."""
    data.qpos[:] = configuration
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)
    mujoco.mj_tendon(model, data)


def _set_appearance(model: mujoco.MjModel, width: int, height: int) -> None:
    """Set a picture's size and light; moving bodies are translucent, so that arrows show."""
    model.vis.global_.offwidth, model.vis.global_.offheight = width, height
    model.vis.quality.shadowsize = _SHADOW
    model.vis.map.alpha = _SOLID
    model.vis.headlight.ambient[:] = np.maximum(model.vis.headlight.ambient, _AMBIENT)


def _shot(scene: mujoco.MjvScene, context: mujoco.MjrContext, width: int, height: int) -> Picture:
    area, picture = mujoco.MjrRect(0, 0, width, height), np.empty((height, width, 3), np.uint8)
    mujoco.mjr_render(area, scene, context)
    mujoco.mjr_readPixels(picture, None, area, context)
    return picture[::-1].copy()


def _draw_background(scene: mujoco.MjvScene) -> None:
    """Put a bright wall behind everything; MuJoCo would leave the background black."""
    eye = scene.camera[0]
    far = _WALL * eye.frustum_far
    half = 2 * far / eye.frustum_near * max(eye.frustum_top, eye.frustum_width, eye.frustum_near)
    place = eye.pos + far * eye.forward
    up, back = eye.up.astype(float), -eye.forward.astype(float)
    turn = np.stack([np.cross(up, back), up, back], axis=1)
    size = np.array([half, half, far * 1e-3])
    wall = _new_geom(scene, mujoco.mjtGeom.mjGEOM_BOX, size, place, turn, _BACKGROUND)
    wall.emission, wall.specular, wall.reflectance = 0.2, 0.0, 0.0
    wall.category = mujoco.mjtCatBit.mjCAT_DECOR.value


def _camera(
    model: mujoco.MjModel, motion: BodyMotion, aspect: float, name: str | None
) -> mujoco.MjvCamera:
    camera = mujoco.MjvCamera()
    if name is not None:
        camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        camera.fixedcamid = _find(model, name)
        return camera
    half = math.radians(float(model.vis.global_.fovy)) / 2
    narrow = min(half, math.atan(math.tan(half) * aspect))
    camera.lookat[:] = motion.centre
    camera.distance = _MARGIN * motion.radius / math.sin(narrow)
    camera.azimuth, camera.elevation = _AZIMUTH, _ELEVATION
    return camera


def _find(model: mujoco.MjModel, name: str) -> int:
    names = [model.camera(index).name for index in range(model.ncam)]
    if name not in names:
        known = f"; it has {', '.join(names)}" if names else "; leave --camera out"
        raise SceneError(f"the model has no camera '{name}'{did_you_mean(name, names)}{known}")
    return names.index(name)


def _draw_forces(scene: mujoco.MjvScene, motion: BodyMotion, frame: int) -> None:
    chosen = motion.forces.of(frame)
    points, arrows = motion.forces.position[chosen], motion.arrows[chosen]
    modes: Sequence[int] = motion.forces.mode[chosen].tolist()
    for point, arrow, mode in zip(points, arrows, modes, strict=True):
        if scene.ngeom == scene.maxgeom:
            return
        width = min(_RADIUS * motion.radius, _MOST_RADIUS * float(np.linalg.norm(arrow)))
        geom = _new_geom(scene, _ARROW, np.zeros(3), np.zeros(3), np.eye(3), MODE_COLOURS[mode])
        mujoco.mjv_connector(geom, _ARROW.value, width, point, point + arrow)


def _new_geom(
    scene: mujoco.MjvScene,
    kind: mujoco.mjtGeom,
    size: Floats,
    place: Floats,
    turn: Floats,
    colour: tuple[float, ...],
) -> mujoco.MjvGeom:
    geom = scene.geoms[scene.ngeom]
    rgba = np.array(colour, np.float32)
    mujoco.mjv_initGeom(geom, kind.value, size, place, turn.ravel(), rgba)
    scene.ngeom += 1
    return geom
