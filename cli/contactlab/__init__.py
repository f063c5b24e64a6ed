"""Evidence for contact simulation.

The command line is the way in: `contactlab sweep bounce`. The same questions can be asked from
Python, where the answers are data:

    import contactlab

    store = contactlab.sweep("bounce")
    store.runs.to_pandas()
    contactlab.examine("path/to/robot.xml").sound

Importing this loads neither the physics engine nor Arrow; the first call does, if it needs them.
Nor does it load any other module, of the package or of Python: the command's own hears Ctrl-C,
and comes next.
"""

TYPE_CHECKING = False  # as type checkers know it; `typing` loads a dozen modules
if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any

    from contactlab.command_line.surroundings import progress
    from contactlab.commands.bisect import bisect
    from contactlab.commands.compare import compare
    from contactlab.commands.diff import diff
    from contactlab.commands.effects import effects
    from contactlab.commands.examine import examine
    from contactlab.commands.explain import explain
    from contactlab.commands.fit import fit
    from contactlab.commands.gradients import gradients
    from contactlab.commands.grip import grip
    from contactlab.commands.init import init
    from contactlab.commands.lint import lint
    from contactlab.commands.list import list
    from contactlab.commands.lock import lock
    from contactlab.commands.parity import parity
    from contactlab.commands.render import render
    from contactlab.commands.report import report
    from contactlab.commands.show import show
    from contactlab.commands.shrink import shrink
    from contactlab.commands.stability import stability
    from contactlab.commands.success import success
    from contactlab.commands.sweep import sweep
    from contactlab.commands.tradeoff import tradeoff
    from contactlab.commands.tune import tune
    from contactlab.commands.verify import verify
    from contactlab.loop.recording import record
    from contactlab.store.finished_store import Store

    open = Store.open  # noqa: A001 - as it is called
    __version__: str

__all__ = [
    "__version__",
    "bisect",
    "compare",
    "diff",
    "effects",
    "examine",
    "explain",
    "fit",
    "gradients",
    "grip",
    "init",
    "lint",
    "list",
    "lock",
    "open",
    "parity",
    "progress",
    "record",
    "render",
    "report",
    "show",
    "shrink",
    "stability",
    "success",
    "sweep",
    "tradeoff",
    "tune",
    "verify",
]


def __getattr__(name: str) -> "Any":  # noqa: ANN401 - each function has a type of its own
    if name == "__version__":
        from importlib.metadata import version

        return version("contactlab")
    from contactlab.parts import register_parts

    register_parts()
    if name not in __all__:
        # A command that another package adds.
        from contactlab.plugins import find_extensions

        extension = None if name.startswith("_") else find_extensions("command").get(name)
        if extension is None:
            from contactlab.command_line.front_door import replacement_of

            new = replacement_of(name)
            hint = f"; `contactlab {name}` is now `contactlab {new}`" if new else ""
            raise AttributeError(f"module 'contactlab' has no attribute '{name}'{hint}")
        return extension.load()
    if name == "open":
        from contactlab.store.finished_store import Store

        return Store.open
    if name == "record":
        from contactlab.loop.recording import record

        return record
    if name == "progress":
        from contactlab.command_line.surroundings import progress

        return progress
    from contactlab.registry import own_parts

    module = own_parts("command module")[name].load()
    return getattr(module, name, module)


def __dir__() -> "Sequence[str]":
    return __all__
