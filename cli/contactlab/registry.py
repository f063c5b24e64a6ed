"""Registries that this package fills, and that plug-ins may add to."""

from collections.abc import Generator
from contextlib import contextmanager
from typing import Any, Generic, Protocol, TypeVar, runtime_checkable

from contactlab.errors import PluginError


@runtime_checkable
class Named(Protocol):
    """An entry of a registry."""

    @property
    def name(self) -> str:
        """Its name in sweeps, scenes, evidence and reports."""
        ...


Entry = TypeVar("Entry", bound=Named)


class Registry(dict[str, Entry], Generic[Entry]):
    """Entries of one kind, such as "metric", by name, in the order in which they were added."""

    def __init__(self, kind: str) -> None:
        super().__init__()
        self.kind = kind
        REGISTRIES.setdefault(kind, self)

    def add(self, entry: Entry) -> Entry:
        """Add an entry and return it; raise PluginError if another has its name."""
        if self.setdefault(entry.name, entry) is not entry:
            raise PluginError(f"there is a {self.kind} named '{entry.name}' already; rename yours")
        return entry


REGISTRIES: dict[str, Registry[Any]] = {}
"""The registries of this process, by the kind of their entries; of a kind, the first one."""


@contextmanager
def transaction() -> Generator[None]:
    """Take back what is added to any registry if an exception leaves the context."""
    before = [(registry, dict(registry)) for registry in REGISTRIES.values()]
    try:
        yield
    except BaseException:
        for registry, entries in before:
            registry.clear()
            registry.update(entries)
        raise
