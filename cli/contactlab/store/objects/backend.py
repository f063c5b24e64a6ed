"""A store in object storage.

Journal, notes, table and scene are made in a local temporary folder. Data that must survive the
process is stored at once: traces by the workers, rows and notes batch by batch, as objects with
unique names.
"""

import shutil
import uuid
from collections import deque
from collections.abc import Collection, Generator, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager
from functools import cached_property
from pathlib import Path
from tempfile import mkdtemp

from contactlab.errors import OutputError, StoreError
from contactlab.schema.evidence import StoreManifest, SweepIdentity
from contactlab.schema.strict_model import is_inner_name
from contactlab.store.objects.client import ObjectClient
from contactlab.store.objects.lease import StoreLease, hold_lease
from contactlab.store.store_files import (
    CONTROLS,
    IDENTITY,
    JOURNAL,
    LOCK,
    MANIFEST,
    NOTES,
    SCENES,
    TABLE,
    TRACES,
    ObjectAddress,
    check_same_sweep,
    document_json,
    parse_manifest,
)
from contactlab.temporary_folders import temporary_folder, temporary_root

_BATCH_FOLDERS = {JOURNAL: "journal", NOTES: "notes"}
"""The folder of batches for each local file of lines."""
_STORE_NAMES = {SCENES, TRACES, CONTROLS, LOCK, *_BATCH_FOLDERS.values(), TABLE, IDENTITY, MANIFEST}
_TRANSFERS = 16  # objects that are fetched or stored in parallel, and traces fetched ahead

_fetched_folders: dict[tuple[ObjectAddress, bytes | str], Path] = {}


class ObjectBackend(ObjectClient):
    """Backend in object storage; see `contactlab.store.backend.Backend`."""

    def read_file(self, name: str) -> bytes | None:
        """Return the content of an object; None if it does not exist."""
        stored_object = self.find_object(name)
        return None if stored_object is None else stored_object.data

    def local_copy(self, manifest: bytes, names: Collection[str]) -> Path:
        """Return a local folder with a manifest and its files, fetched if the manifest is new."""
        if (self.address, manifest) not in _fetched_folders:
            folder = self._fetched_folders(names)
            (folder / MANIFEST).write_bytes(manifest)
            _fetched_folders[self.address, manifest] = folder
        return _fetched_folders[self.address, manifest]

    def local_folder(self, name: str) -> Path:
        """Return a local folder with all objects of a folder, fetched once per process."""
        if (self.address, name) not in _fetched_folders:
            names = [file for file, _ in self.list_sizes(name)]
            if not names:
                raise OutputError(f"{self.address / name} is missing; has the sweep been removed?")
            _fetched_folders[self.address, name] = self._fetched_folders(names) / name
        return _fetched_folders[self.address, name]

    def _fetched_folders(self, names: Iterable[str]) -> Path:
        """Return a new folder with some objects, which is removed when the process ends."""
        folder = Path(mkdtemp(dir=temporary_root()))
        safe = [_safe_name(name, self.address) for name in names]
        with ThreadPoolExecutor(_TRANSFERS) as pool:
            list(pool.map(self.fetch_object, safe, [folder / name for name in safe]))
        return folder

    @cached_property
    def _trace_sizes(self) -> dict[str, int]:
        return dict(self.list_sizes(TRACES))

    def trace_size(self, name: str) -> int | None:
        """Return the size of a trace [bytes], from a cached listing; None if it does not exist."""
        return self._trace_sizes.get(name)

    def holds_trace(self, name: str, size: int, sha256: str) -> bool:
        """Return whether a trace of this size exists; objects are stored whole, with checksums."""
        del sha256
        return self.trace_size(name) == size

    def trace_names(self) -> list[str]:
        """Return the names of all traces, sorted."""
        return sorted(self._trace_sizes)

    def local_files(self, names: Iterable[str]) -> Generator[Path | None]:
        """Yield a local file for each object, some fetched ahead; None if it is missing."""
        coming: deque[tuple[Path, Future[bool]]] = deque()
        with (
            temporary_folder() as folder,
            ThreadPoolExecutor(_TRANSFERS) as pool,
        ):
            for number, name in enumerate(names):
                source, target = _safe_name(name, self.address), Path(folder) / str(number)
                coming.append((target, pool.submit(self.fetch_object, source, target)))
                if len(coming) > _TRANSFERS:
                    yield from _take_first(coming)
            while coming:
                yield from _take_first(coming)

    def file_names(self) -> Iterator[str]:
        """Yield the names of all objects."""
        yield from (name for name, _ in self.list_sizes())

    def leftover_names(self) -> list[str]:
        """Return the names of batches that an interrupted sweep left, sorted."""
        return sorted(
            name for batch in _BATCH_FOLDERS.values() for name, _ in self.list_sizes(batch)
        )

    def foreign_names(self) -> list[str]:
        """Return the names of objects that do not belong to a store, sorted."""
        return sorted(self.top_names() - _STORE_NAMES)

    @contextmanager
    def write_session(self) -> Generator["ObjectSession"]:
        """Hold the store's lease."""
        with hold_lease(self) as lease, temporary_folder() as folder:
            yield ObjectSession(self, lease, Path(folder))


def _take_first(coming: deque[tuple[Path, Future[bool]]]) -> Iterator[Path | None]:
    path, presence = coming.popleft()
    yield path if presence.result() else None
    path.unlink(missing_ok=True)


class ObjectSession:
    """Session of a store in object storage, with a temporary local folder; see `WriteSession`."""

    def __init__(self, objects: ObjectBackend, lease: StoreLease, folder: Path) -> None:
        self.folder = folder
        self._objects = objects
        self._lease = lease
        self._pool = ThreadPoolExecutor(_TRANSFERS, thread_name_prefix="uploads")
        self._uploads: deque[Future[None]] = deque()
        self._batches: list[str] = []
        self._fetched_bytes = 0

    def clear_store(self) -> None:
        """Remove all objects except the lock."""
        # The manifest goes first and the identity last: a half-removed store must not look
        # finished, nor contain runs without a sweep.
        self._objects.delete_files([MANIFEST])
        kept_names = {LOCK, IDENTITY}
        self._objects.delete_files(
            [name for name, _ in self._objects.list_sizes() if name not in kept_names]
        )
        self._objects.delete_files([IDENTITY])

    def begin_store(self, identity: SweepIdentity) -> None:
        """Store the scene and, last, the identity."""
        for file in sorted(path for path in (self.folder / SCENES).rglob("*") if path.is_file()):
            self._objects.put_file(file.relative_to(self.folder).as_posix(), file)
        (self.folder / IDENTITY).write_text(document_json(identity), encoding="utf-8")
        self._objects.put_file(IDENTITY, self.folder / IDENTITY)

    def fetch_journal(self) -> None:
        """Join the batches of rows and of notes into local files."""
        self._objects.fetch_object(IDENTITY, self.folder / IDENTITY)
        self._join_batches(NOTES)
        self._batches = self._join_batches(JOURNAL)
        self._fetched_bytes = self._journal_bytes()

    def replace_journal(self) -> None:
        """Replace the batches by the local journal, if it has lost lines.

        Dropped lines must stay dropped, even if their trace is stored again.
        """
        if self._batches and self._journal_bytes() < self._fetched_bytes:
            self._put_journal()
            self._objects.delete_files(self._batches)

    def add_lines(self, name: str, lines: Sequence[bytes]) -> None:
        """Upload lines in the background, as a separate batch; wait while many are queued."""
        self._lease.check_held()
        # Most unfinished uploads at once.
        self._await_uploads(64)
        batch = _new_batch(name)
        self._uploads.append(self._pool.submit(self._objects.put_file, batch, b"".join(lines)))

    def flush_lines(self) -> None:
        """Wait until all lines are uploaded."""
        self._await_uploads(0)
        self._pool.shutdown()

    def _await_uploads(self, most: int) -> None:
        """Wait until at most `most` uploads are unfinished; after an error, start no other."""
        try:
            while self._uploads and (len(self._uploads) > most or self._uploads[0].done()):
                self._uploads.popleft().result()
        except BaseException:
            self._uploads.clear()
            self._pool.shutdown(cancel_futures=True)
            raise

    def table_file(self) -> Path:
        """Fetch the table."""
        self._objects.fetch_object(TABLE, self.folder / TABLE)
        return self.folder / TABLE

    def publish_store(self, manifest: StoreManifest) -> StoreManifest:
        """Store the table, then the manifest, unless another sweep has published meanwhile."""
        data = document_json(manifest).encode()
        published = self._objects.find_object(MANIFEST)
        if published is None:
            self._lease.renew_lock()
            self._objects.put_file(TABLE, self.folder / TABLE)
            if self._objects.create_object(MANIFEST, data) is None:
                # Another sweep has published since the renewal, and our table is now next to its
                # manifest; the two must match.
                self._objects.put_file(MANIFEST, data)
        else:
            theirs = parse_manifest(published.data, self._objects.address)
            check_same_sweep(self._objects.address, theirs.sweep, manifest.sweep)
            manifest = theirs
        self.remove_journal()
        return manifest

    def reopen_store(self) -> None:
        """Store the rows of the local journal, then delete manifest and table."""
        self._put_journal()
        for name in (MANIFEST, TABLE):
            self._objects.delete_files([name])

    def remove_journal(self) -> None:
        """Delete all batches."""
        for folder in _BATCH_FOLDERS.values():
            self._objects.delete_files([name for name, _ in self._objects.list_sizes(folder)])

    def remove_temporaries(self) -> None:
        """Do nothing: an object is stored whole."""

    def _journal_bytes(self) -> int:
        return (self.folder / JOURNAL).stat().st_size

    def _put_journal(self) -> None:
        self._objects.put_file(_new_batch(JOURNAL), self.folder / JOURNAL)

    def _join_batches(self, target: str) -> list[str]:
        names = [name for name, _ in self._objects.list_sizes(_BATCH_FOLDERS[target])]
        with (
            (self.folder / target).open("wb") as joined_file,
            closing(self._objects.local_files(names)) as parts,
        ):
            for part in filter(None, parts):
                with part.open("rb") as lines:
                    shutil.copyfileobj(lines, joined_file)
        return names


def _new_batch(name: str) -> str:
    """Return a unique object name for lines of a local file."""
    return f"{_BATCH_FOLDERS[name]}/{uuid.uuid4().hex}.jsonl"


def _safe_name(name: str, address: ObjectAddress) -> str:
    """Return a file name from a store, after checking that it does not lead out of the store."""
    if not is_inner_name(name):
        raise StoreError(f"{address} is damaged: it names a file '{name}'")
    return name
