"""Settings that a process of contactlab's own makes first, so that the rest starts fast.

A process of another program, with contactlab as a library, stays unchanged.
"""

import atexit
import ctypes
import gc
import os
import sys
from types import ModuleType

# Nearly all that is made at the start stays: garbage is looked for after this number of new
# objects.
gc.set_threshold(200_000)
# At the end the system takes all memory back; a last search for garbage would only take time.
atexit.register(gc.freeze)
# Workers have a core each, which BLAS's threads would share.
os.environ["OPENBLAS_NUM_THREADS"] = "1"
# By default glibc takes blocks of up to 32 MB from its heap once one was freed, where small blocks
# between them keep the memory: with copies of a model of 24 MB, an examination grew to 3.7 GB.
# Blocks from 16 MB on go back to the system when they are freed; smaller ones of sweeps are reused.
if sys.platform == "linux" and hasattr(_LIBRARY := ctypes.CDLL(None), "mallopt"):
    _LIBRARY.mallopt(_MMAP_THRESHOLD := -3, 16 << 20)
# Arrow's own allocators keep freed memory, a tenth of a report's peak, and are not faster here.
os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
# Pydantic would search all installed packages for its plug-ins.
os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
# GLFW starts a process as MuJoCo loads it, and cannot draw without a display.
if sys.platform == "linux" and not os.environ.keys() & {"DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL"}:

    class _MissingContext:
        def __init__(self, *_: object) -> None:
            raise ImportError("GLFW needs a display; set MUJOCO_GL to egl or osmesa")

    # MuJoCo up to 3.x does not load without this module.
    _without_glfw = ModuleType("mujoco.glfw")
    _without_glfw.GLContext = _MissingContext  # pyright: ignore[reportAttributeAccessIssue]
    sys.modules.setdefault("mujoco.glfw", _without_glfw)
