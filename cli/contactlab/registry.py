"""Registries that this package fills, and that plug-ins may add to."""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
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


_Entries = dict[str, tuple[Registry[Any], dict[str, Any]]]
_OPEN: list[_Entries] = []


@contextmanager
def transaction() -> Generator[None]:
    """Take back what is added to any registry if an exception leaves the context."""
    before: _Entries = {}
    _OPEN.append(before)
    settle()
    try:
        yield
    except BaseException:
        for registry, entries in before.values():
            registry.clear()
            registry.update(entries)
        raise
    finally:
        _OPEN.pop()


def settle() -> None:
    """Keep what registries have that were made since a transaction began, if it is taken back.

    A package with a registry calls it when it has all its own entries, since a plug-in may be the
    first to import it.
    """
    for before in _OPEN:
        for kind, registry in REGISTRIES.items():
            before.setdefault(kind, (registry, dict(registry)))


@dataclass(frozen=True)
class Part:
    """An extension that is imported when it is loaded, as an installed package's entry point is."""

    load: Callable[[], Any]


PARTS: dict[str, dict[str, Part]] = {}
"""contactlab's own extensions by kind and name."""


def part(kind: str, *names: str) -> Callable[[Callable[[], Any]], Callable[[], Any]]:
    """Register a function that imports and returns an extension of a kind, under some names."""

    def register(load: Callable[[], Any]) -> Callable[[], Any]:
        PARTS.setdefault(kind, {}).update(dict.fromkeys(names, Part(load)))
        return load

    return register
