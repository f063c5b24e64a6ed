"""A place to draw without a display."""

import ctypes.util
import importlib
import os
from collections.abc import Generator
from contextlib import contextmanager

from contactlab.errors import SceneError

# What MUJOCO_GL may ask for, with the system's library behind it.
_BACKENDS = {"egl": "EGL", "osmesa": "OSMesa", "glfw": "glfw"}
_REMEDY = (
    "install EGL or OSMesa (Debian: apt install libegl1 libgl1-mesa-dri, or libosmesa6) and choose "
    "with MUJOCO_GL=egl or MUJOCO_GL=osmesa; .mcap and .rrd files need neither"
)


@contextmanager
def graphics(width: int, height: int) -> Generator[None]:
    """Make an OpenGL context of so many pixels the current one.

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
