"""The page of functions; Sphinx takes their texts from the package."""

from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import contactlab
from contactlab.command_line.declaration import is_declared

_CLASSES = (
    "contactlab.store.finished_store.Store",
    "contactlab.store.finished_store.Runs",
)


def write(folder: Path) -> tuple[str, ...]:
    """Write the page into the folder of references; return its name from the folder above."""
    (folder / "functions.md").write_text("\n".join(_functions()) + "\n", encoding="utf-8")
    return (f"{folder.name}/functions",)


def _functions() -> Iterator[str]:
    yield "# Functions\n\n```{eval-rst}"
    for name in contactlab.__all__:
        if isinstance(found := getattr(contactlab, name), ModuleType):
            commands = [command for command in vars(found).values() if is_declared(command)]
            yield from (f".. autofunction:: {found.__name__}.{one.__name__}" for one in commands)
        elif not name.startswith("_"):
            yield f".. autofunction:: contactlab.{name}"
    for name in _CLASSES:
        yield f".. autoclass:: {name}\n   :members:"
    yield "```"
