"""Operations that a store needs from its location."""

from collections.abc import Collection, Generator, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Protocol

from contactlab.schema.evidence import StoreManifest, SweepIdentity
from contactlab.store.store_files import Address


class WriteSession(Protocol):
    """A store that is locked for writing.

    Journal, notes, table and scene are made in a local folder.
    """

    @property
    def folder(self) -> Path:
        """The local folder."""
        ...

    def clear_store(self) -> None:
        """Remove the whole store, the manifest first and the identity last."""

    def begin_store(self, identity: SweepIdentity) -> None:
        """Make a new store from the local folder's scene and the identity, which comes last."""

    def fetch_journal(self) -> None:
        """Fetch the rows and notes of an unfinished store into the local folder."""

    def replace_journal(self) -> None:
        """Make the local journal the store's; rows missing in it are removed."""

    def add_lines(self, name: str, lines: Sequence[bytes]) -> None:
        """Store lines that were appended to a local file, in the background."""

    def flush_lines(self) -> None:
        """Wait until all lines are stored."""

    def table_file(self) -> Path:
        """Return a local file with the table of a finished store."""
        ...

    def publish_store(self, manifest: StoreManifest) -> StoreManifest:
        """Store the table and, last, the manifest. Return the manifest in the store."""
        ...

    def reopen_store(self) -> None:
        """Make a finished store unfinished, with the rows of the local journal."""

    def remove_journal(self) -> None:
        """Remove the rows and notes of a finished store."""

    def remove_temporaries(self) -> None:
        """Remove temporary files that stopped processes have left."""


class Backend(Protocol):
    """The location of a store. File names are relative to it, with slashes.

    Methods raise the error class passed to `backend_at`, or OutputError on writing.
    """

    @property
    def address(self) -> Address:
        """Its address."""
        ...

    def top_names(self) -> set[str]:
        """Return the names of the files and folders at the top."""
        ...

    def read_file(self, name: str) -> bytes | None:
        """Return the content of a file; None if it does not exist."""
        ...

    def put_file(self, name: str, data: bytes) -> None:
        """Create or replace a file as a whole."""

    def delete_files(self, names: Iterable[str]) -> None:
        """Delete files; missing ones are ignored."""

    def local_copy(self, manifest: bytes, names: Collection[str]) -> Path:
        """Return a local folder with a manifest and its files; it exists until the process ends."""
        ...

    def local_folder(self, name: str) -> Path:
        """Return a local folder with all files of one of the store's folders, likewise."""
        ...

    def trace_size(self, name: str) -> int | None:
        """Return the size of a trace [bytes]; None if it does not exist."""
        ...

    def holds_trace(self, name: str, size: int, sha256: str) -> bool:
        """Return whether a trace with this size and content exists."""
        ...

    def trace_names(self) -> list[str]:
        """Return the names of all traces, sorted."""
        ...

    def local_files(self, names: Iterable[str]) -> Generator[Path | None]:
        """Yield a local file for each trace, valid until the next one; None if it is missing."""
        ...

    def file_names(self) -> Iterator[str]:
        """Yield the names of all files, and of empty folders, which end with a slash."""
        ...

    def leftover_names(self) -> list[str]:
        """Return the names of files left by an interrupted write, sorted."""
        ...

    def foreign_names(self) -> list[str]:
        """Return the names of entries that do not belong to a store, sorted."""
        ...

    def write_session(self) -> AbstractContextManager[WriteSession]:
        """Lock the store, at the latest until the process ends."""
        ...
