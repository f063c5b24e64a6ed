"""Registries that this package fills, and that plug-ins may add to."""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar, runtime_checkable

from contactlab.errors import PluginError


@runtime_checkable
class NamedEntry(Protocol):
    """An entry of a registry."""

    @property
    def name(self) -> str:
        """Its name in sweeps, scenes, evidence and reports."""
        ...


Entry = TypeVar("Entry", bound=NamedEntry)


class Registry(dict[str, Entry], Generic[Entry]):
    """Entries of one kind, such as "metric", by name, in order of addition."""

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
    """Remove the entries that are added to any registry if an exception leaves the context."""
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
    """Keep the entries of registries that were made since a transaction began, if it fails.

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
"""contactlab's own extensions by kind and name, once the registry is filled."""
_FILLERS: list[Callable[[], None]] = []


def add_part(kind: str, load: Callable[[], Any], *names: str) -> None:
    """Register a function that imports and returns an extension of a kind, under some names."""
    PARTS.setdefault(kind, {}).update(dict.fromkeys(names, Part(load)))


def fill_registry(*fillers: Callable[[], None]) -> None:
    """Call functions that add parts, once each in this process.

    An entry of the program calls it, since a registry does not import the packages of its parts.
    Workers call the same functions when they start.
    """
    for filler in fillers:
        if filler not in _FILLERS:
            filler()
            _FILLERS.append(filler)


def registry_fillers() -> tuple[Callable[[], None], ...]:
    """Return the functions that filled the registry of this process."""
    return tuple(_FILLERS)


def own_parts(kind: str) -> dict[str, Part]:
    """Return contactlab's own extensions of a kind by name.

    Raises:
        RuntimeError: no entry of the program has filled the registry of this process.
    """
    if not _FILLERS:
        raise RuntimeError(
            "the registry of contactlab is empty; call functions of `contactlab`, or import "
            "`contactlab.plugin` first"
        )
    return dict(PARTS.get(kind, {}))
