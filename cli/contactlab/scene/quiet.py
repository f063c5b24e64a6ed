"""Keep the engine's own log to itself."""

import ctypes
from functools import cache
from pathlib import Path
from typing import Any

import mujoco


def quiet() -> None:
    """Keep the engine from writing MUJOCO_LOG.TXT and messages; warnings are counted anyway."""
    if hasattr(mujoco, "MjLogConfig"):
        config = mujoco.MjLogConfig.get()
        config.logto_file = config.logto_console = False
        config.set()
    else:
        _quieten()


@cache
def _quieten() -> Any:  # noqa: ANN401 - a function that C may call, kept alive by the cache
    """Take warnings where the engine has no settings for its log: before 3.10."""
    take = ctypes.CFUNCTYPE(None, ctypes.c_char_p)(lambda _: None)
    (library,) = Path(mujoco.__file__).parent.glob("libmujoco*.so*")
    handler = ctypes.c_void_p.in_dll(ctypes.CDLL(str(library)), "mju_user_warning")
    handler.value = ctypes.cast(take, ctypes.c_void_p).value
    return take
