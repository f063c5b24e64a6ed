"""What a process of contactlab's own imports first, so that the rest starts fast.

A process of somebody else's, where contactlab is a library, is left as it is.
"""

import atexit
import gc
import os
import sys
from collections.abc import Sequence
from importlib import import_module, reload
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from types import ModuleType
from typing import Any

# Nearly all that is made at the start stays: garbage is looked for after so many new objects.
gc.set_threshold(200_000)
# And not at the end, of all that goes anyway.
atexit.register(gc.freeze)
# Workers, which have a core each, are forked from here: they would lose BLAS's threads.
os.environ["OPENBLAS_NUM_THREADS"] = "1"
# Pydantic would look through all that is installed for what watches it.
os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")


class _RunsWhenUsed(ModuleType):
    """A module that runs when something of it is asked for, not when it is imported."""

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - of any type
        if name.startswith("__"):
            raise AttributeError(name)
        object.__setattr__(self, "__class__", ModuleType)
        return getattr(reload(self), name)


class _RunsWhenWrapped(_RunsWhenUsed):
    """Arrow's functions, of which most callers want the compiled ones, not hundreds of wrappers."""

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - of any type
        compiled = import_module("pyarrow._compute")
        return getattr(compiled, name) if hasattr(compiled, name) else super().__getattr__(name)


# MuJoCo imports glfw at once, which starts a process of its own, and uses it for windows.
_LATER = {"glfw": _RunsWhenUsed, "pyarrow.compute": _RunsWhenWrapped}


class _LaterLoader(SourceFileLoader):
    def create_module(self, spec: ModuleSpec) -> ModuleType:
        return _LATER[spec.name](spec.name)

    def exec_module(self, module: ModuleType) -> None:
        pass


class _LaterFinder:
    """Finds such modules as they are imported; to run them, they are reloaded as others are."""

    @staticmethod
    def find_spec(
        name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        found = PathFinder.find_spec(name, path) if name in _LATER and target is None else None
        if found is not None:
            found.loader = _LaterLoader(name, str(found.origin))
        return found


sys.meta_path.insert(0, _LaterFinder)
