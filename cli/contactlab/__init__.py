"""Evidence for contact simulation.

The command line is the way in: `contactlab sweep bounce`. The same questions can be asked from
Python, where the answers are data:

    import contactlab

    store = contactlab.sweep("bounce")
    store.runs.to_pandas()
    contactlab.check("path/to/robot.xml").passed

Importing this loads neither the physics engine nor Arrow; the first call does, if it needs them.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from contactlab.api.reading_functions import compare, open, report
    from contactlab.api.running_functions import check, effects, stability, sweep, tradeoff
    from contactlab_fit.function import fit
    from contactlab_loop.recording import record
    from contactlab_tune.function import tune

    __version__: str

__all__ = [
    "__version__",
    "check",
    "compare",
    "effects",
    "fit",
    "open",
    "record",
    "report",
    "stability",
    "sweep",
    "tradeoff",
    "tune",
]
_READING = {"compare", "open", "report"}


def __getattr__(name: str) -> Any:  # noqa: ANN401 - each function has a type of its own
    if name not in __all__:
        raise AttributeError(f"module 'contactlab' has no attribute '{name}'")
    if name == "__version__":
        from importlib.metadata import version

        return version("contactlab")
    if name in _READING:
        from contactlab.api import reading_functions as functions
    elif name == "fit":
        from contactlab_fit import function as functions
    elif name == "tune":
        from contactlab_tune import function as functions
    elif name == "record":
        from contactlab_loop import recording as functions
    else:
        from contactlab.api import running_functions as functions
    return getattr(functions, name)


def __dir__() -> list[str]:
    return __all__
