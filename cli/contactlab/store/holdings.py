"""What lies in a store beside what its manifest names: traces, and what writes left over."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Protocol

from contactlab.store.atomic_files import TEMPORARY_SUFFIX
from contactlab.store.objects import ObjectHoldings
from contactlab.store.row_journal import JOURNAL, NOTES
from contactlab.store.store_address import Address
from contactlab.store.store_writer import TRACES


class Holdings(Protocol):
    """The traces and leftovers of a store, by their names relative to it."""

    def size(self, name: str) -> int | None:
        """Return how large a trace is [bytes]; None if there is none."""
        ...

    def traces(self) -> list[str]:
        """Return the names of all traces, sorted."""
        ...

    def leftovers(self) -> list[str]:
        """Return the names of what an interrupted write left, sorted."""
        ...

    def files(self, names: Iterable[str]) -> Iterator[Path | None]:
        """Yield a file with each trace, which is there until the next one; None if it is missing.

        Args:
            names: the traces' names, asked for as the files are.
        """
        ...


def holdings(address: Address) -> Holdings:
    """Return what lies in a store."""
    return FolderHoldings(address) if isinstance(address, Path) else ObjectHoldings(address)


class FolderHoldings:
    """The traces and leftovers of a store in a folder; see `Holdings`."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def size(self, name: str) -> int | None:
        """Return how large a trace is [bytes]; None if there is none."""
        path = self._folder / name
        return path.stat().st_size if path.is_file() else None

    def traces(self) -> list[str]:
        """Return the names of all traces."""
        return self._names((self._folder / TRACES).rglob("*.mcap"))

    def leftovers(self) -> list[str]:
        """Return the names of what an interrupted write left."""
        own = (self._folder / name for name in (JOURNAL, NOTES))
        begun = self._folder.rglob("*" + TEMPORARY_SUFFIX)
        return self._names([*(path for path in own if path.exists()), *begun])

    def files(self, names: Iterable[str]) -> Iterator[Path | None]:
        """Yield the file of each trace; None if it is missing."""
        for name in names:
            path = self._folder / name
            yield path if path.is_file() else None

    def _names(self, paths: Iterable[Path]) -> list[str]:
        return [path.relative_to(self._folder).as_posix() for path in sorted(paths)]
