"""What a process of contactlab's own imports first, so that the rest starts fast.

A process of somebody else's, where contactlab is a library, is left as it is.
"""

import atexit
import gc
import os
import sys
from importlib import reload
from importlib.util import find_spec, module_from_spec
from types import ModuleType
from typing import Any

# Nearly all that is made at the start stays: garbage is looked for after so many new objects.
gc.set_threshold(200_000)
# And not at the end, of all that goes anyway.
atexit.register(gc.freeze)
# Workers, which have a core each, are forked from here: they would lose BLAS's threads.
os.environ["OPENBLAS_NUM_THREADS"] = "1"


class _RunsWhenUsed(ModuleType):
    """A module that runs when something of it is asked for, not when it is imported."""

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - of any type
        if name.startswith("__"):
            raise AttributeError(name)
        object.__setattr__(self, "__class__", ModuleType)
        return getattr(reload(self), name)


# MuJoCo imports it at once, which starts a process of its own, and uses it for windows.
if (spec := find_spec("glfw")) is not None:
    sys.modules["glfw"] = module_from_spec(spec)
    sys.modules["glfw"].__class__ = _RunsWhenUsed
