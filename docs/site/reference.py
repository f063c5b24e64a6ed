"""The pages of functions and of keys, which only the site has."""

from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

from docs.generate import KEYS, write_page

import contactlab
from contactlab.command_line.declaration import is_declared

_CLASSES = (
    "contactlab.store.finished_store.Store",
    "contactlab.store.finished_store.Runs",
)


def write(folder: Path) -> tuple[str, ...]:
    """Write the pages into the folder of references; return their names from the folder above."""
    pages = {"functions": "\n".join(_functions()) + "\n", "keys": write_page(KEYS)}
    for name, text in pages.items():
        (folder / f"{name}.md").write_text(text, encoding="utf-8")
    return tuple(f"{folder.name}/{name}" for name in pages)


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
