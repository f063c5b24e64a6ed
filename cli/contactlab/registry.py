"""Tables that this package fills, and that plug-ins may add to."""

from collections.abc import Iterator, Mapping
from typing import Generic, Protocol, TypeVar

from contactlab.errors import PluginError


class Named(Protocol):
    """What a registry holds."""

    @property
    def name(self) -> str:
        """Its name in sweeps, scenes, evidence and reports."""
        ...


Entry = TypeVar("Entry", bound=Named)


class Registry(Mapping[str, Entry], Generic[Entry]):
    """Entries of one kind by name, in the order in which they were added.

    Args:
        kind: what an entry is called in messages, such as "metric".
    """

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self._entries: dict[str, Entry] = {}

    def add(self, entry: Entry) -> Entry:
        """Add an entry and return it; adding the same object twice changes nothing.

        Raises:
            PluginError: another entry has this name.
        """
        if self._entries.setdefault(entry.name, entry) is not entry:
            raise PluginError(f"there is a {self.kind} named '{entry.name}' already; rename yours")
        return entry

    def __getitem__(self, name: str) -> Entry:
        return self._entries[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)
