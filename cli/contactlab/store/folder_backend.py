"""A store in a local folder."""

import fcntl
import os
import shutil
from collections.abc import Collection, Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from contactlab.errors import ContactlabError, OutputError, optional
from contactlab.plugins import find_extensions
from contactlab.schema.evidence import StoreManifest, SweepIdentity
from contactlab.store.atomic_files import (
    TEMPORARY_SUFFIX,
    GroupCommit,
    atomic_write,
    sha256_of,
    sync_filesystem,
    target_name,
    write_errors,
    write_file,
)
from contactlab.store.backend import Backend
from contactlab.store.store_files import (
    CONTROLS,
    IDENTITY,
    JOURNAL,
    LOCK,
    MANIFEST,
    MOST_TRACE,
    NOTES,
    SCENES,
    TABLE,
    TRACES,
    Address,
    check_tree,
    document_json,
    read_stored,
    stored_file,
    stored_size,
)

_FILE_NAMES = (MANIFEST, IDENTITY, TABLE, JOURNAL, NOTES)
_STORE_NAMES = {SCENES, TRACES, CONTROLS, LOCK, *_FILE_NAMES}


class FolderBackend:
    """Backend in a local folder; see `Backend`."""

    def __init__(self, folder: Path, error: type[ContactlabError]) -> None:
        self.address = folder
        self._error = error
        self._made: set[str] = set()

    def top_names(self) -> set[str]:
        """Return the names of the files and folders at the top."""
        return {path.name for path in self.address.iterdir()} if self.address.is_dir() else set()

    def read_file(self, name: str) -> bytes | None:
        """Return the content of a file; None if it does not exist."""
        try:
            return read_stored(self.address, name)
        except OSError as error:
            raise self._error(f"cannot read {self.address / name}: {error.strerror}") from error

    def put_file(self, name: str, data: bytes) -> None:
        """Create or replace a file as a whole."""
        folder = name.rpartition("/")[0]
        # Cached, because asking the system for each file takes longer.
        if folder not in self._made:
            with write_errors(self.address / name):
                (self.address / folder).mkdir(parents=True, exist_ok=True)
            self._made.add(folder)
        write_file(f"{self.address}/{name}", data)

    def delete_files(self, names: Iterable[str]) -> None:
        """Delete files; missing ones are ignored."""
        for path in (self.address / name for name in names):
            with write_errors(path):
                path.unlink(missing_ok=True)

    def local_copy(self, manifest: bytes, names: Collection[str]) -> Path:
        """Return a local folder with a manifest and its files; it exists until the process ends."""
        del manifest, names
        return self.address

    def local_folder(self, name: str) -> Path:
        """Return a local folder with all files of one of the store's folders, likewise."""
        return self.address / name

    def trace_size(self, name: str) -> int | None:
        """Return the size of a trace [bytes]; None if it does not exist."""
        return stored_size(self.address, name)

    def holds_trace(self, name: str, size: int, sha256: str) -> bool:
        """Return whether a trace with this size and content exists."""
        return self.trace_size(name) == size and sha256_of(self.address / name) == sha256

    def trace_names(self) -> list[str]:
        """Return the names of all traces, sorted."""
        return self._relative_names((self.address / TRACES).rglob("*.mcap"))

    def local_files(self, names: Iterable[str]) -> Generator[Path | None]:
        """Yield a local file for each trace, valid until the next one; None if it is missing."""
        for name in names:
            yield stored_file(self.address, name, MOST_TRACE)

    def file_names(self) -> Iterator[str]:
        """Yield the names of all files, and of empty folders, which end with a slash."""
        for folder, folders, files in os.walk(self.address):
            folders.sort()
            inner = Path(folder).relative_to(self.address).as_posix()
            prefix = "" if inner == "." else f"{inner}/"
            yield from (prefix + name for name in sorted(files))
            if prefix and not files and not folders:
                yield prefix

    def leftover_names(self) -> list[str]:
        """Return the names of files left by an interrupted write, sorted."""
        journals = (self.address / name for name in (JOURNAL, NOTES))
        temporary = self.address.rglob("*" + TEMPORARY_SUFFIX)
        return self._relative_names([*(path for path in journals if path.exists()), *temporary])

    def foreign_names(self) -> list[str]:
        """Return the names of entries that do not belong to a store, sorted."""
        return sorted(name for name in self.top_names() if target_name(name) not in _STORE_NAMES)

    def temporary_names(self) -> list[str]:
        """Return the names of temporary files at the top left by stopped processes."""
        return [
            name for name in self.top_names() - {*_FILE_NAMES} if target_name(name) in _FILE_NAMES
        ]

    @contextmanager
    def write_session(self) -> Generator["FolderSession"]:
        """Hold the store's lock, which the system releases when the process ends."""
        self.address.mkdir(parents=True, exist_ok=True)
        for name in (name for name in self.top_names() if target_name(name) in _STORE_NAMES):
            check_tree(self.address / name)
        with (self.address / LOCK).open("a") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                message = f"{self.address} is in use by another sweep; wait or use -o"
                raise OutputError(message) from error
            yield FolderSession(self)

    def _relative_names(self, paths: Iterable[Path]) -> list[str]:
        return [path.relative_to(self.address).as_posix() for path in sorted(paths)]


class FolderSession:
    """Session of a store in a local folder, which is the store itself; see `WriteSession`."""

    def __init__(self, backend: FolderBackend) -> None:
        self.folder = backend.address
        self._backend = backend
        self._commit: GroupCommit | None = None

    def clear_store(self) -> None:
        """Remove the whole store."""
        # The manifest goes first and the identity last: a half-removed store must not look
        # finished, nor contain runs without a sweep.
        self._backend.delete_files([MANIFEST, JOURNAL, NOTES, TABLE, IDENTITY])
        for name in (SCENES, TRACES, CONTROLS):
            shutil.rmtree(self.folder / name, ignore_errors=True)

    def begin_store(self, identity: SweepIdentity) -> None:
        """Make a new store from the local folder's scene and the identity, which comes last."""
        (self.folder / TRACES).mkdir(exist_ok=True)
        sync_filesystem(self.folder)
        with atomic_write(self.folder / IDENTITY, durable=True) as temporary:
            temporary.write_text(document_json(identity), encoding="utf-8")

    def fetch_journal(self) -> None:
        """Prepare the rows and notes of an unfinished store in the local folder."""
        self.remove_temporaries()

    def replace_journal(self) -> None:
        """Do nothing: the local journal is the store's."""

    def add_lines(self, name: str, lines: Sequence[bytes]) -> None:
        """Write lines that were appended to a local file to disk within a second."""
        del name, lines
        self._commit = self._commit or GroupCommit(self.folder)
        self._commit.request_sync()

    def flush_lines(self) -> None:
        """Wait until all lines are stored."""
        commit, self._commit = self._commit, None
        if commit is not None:
            commit.close()

    def table_file(self) -> Path:
        """Return a local file with the table of a finished store."""
        return self.folder / TABLE

    def publish_store(self, manifest: StoreManifest) -> StoreManifest:
        """Store the table and, last, the manifest. Return the manifest in the store."""
        self.remove_temporaries()
        sync_filesystem(self.folder)
        with atomic_write(self.folder / MANIFEST, durable=True) as temporary:
            temporary.write_text(document_json(manifest), encoding="utf-8")
        self.remove_journal()
        return manifest

    def reopen_store(self) -> None:
        """Make a finished store unfinished, with the rows of the local journal."""
        self._backend.delete_files([MANIFEST])
        sync_filesystem(self.folder)

    def remove_journal(self) -> None:
        """Remove the rows and notes of a finished store."""
        self._backend.delete_files([JOURNAL, NOTES, *self._backend.temporary_names()])

    def remove_temporaries(self) -> None:
        """Remove temporary files left by stopped processes, such as killed workers."""
        self._backend.delete_files(self._backend.temporary_names())
        for name in (TRACES, CONTROLS):
            for leftover in (self.folder / name).rglob("*" + TEMPORARY_SUFFIX):
                leftover.unlink()


def backend_at(address: Address, error: type[ContactlabError]) -> Backend:
    """Return the backend of a store; make it in the process that uses it.

    Errors of object storage and of reading are of the `error` class.
    """
    if isinstance(address, Path):
        return FolderBackend(address, error)
    with optional("objects", f"a store at {address.scheme}://"):
        return find_extensions("store")[address.scheme].load()(address, error)
