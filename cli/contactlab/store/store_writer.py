"""Write a store so that it can be interrupted at any point and resumed by the same command.

Rows go to a journal as runs finish; the table follows at the end, and the manifest comes last.
"""

import json
from collections.abc import Collection, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol

from contactlab.errors import OutputError, StoreError
from contactlab.schema.evidence import Provenance, StoreManifest, SweepIdentity
from contactlab.store.atomic_files import atomic_write, sha256_of, write_error
from contactlab.store.backend_protocol import (
    IDENTITY,
    JOURNAL,
    MANIFEST,
    NOTES,
    SCENES,
    TABLE,
    Backend,
    WriteSession,
)
from contactlab.store.row_journal import (
    FAILED_STATUSES,
    Journal,
    amend_journal,
    drop_failed_rows,
    failed_traces,
    mend_journal,
    mend_notes,
    read_lines,
)
from contactlab.store.runs_table import (
    OUTCOME_COLUMNS,
    count_outcomes,
    iterate_rows,
    read_table,
    write_table,
)
from contactlab.store.store_access import backend_at
from contactlab.store.store_address import Address
from contactlab.store.store_manifest import check_same_sweep, parse_identity, parse_manifest
from contactlab.store.table_layout import Column

_NO_AMENDMENTS: Mapping[str, Mapping[str, Any]] = MappingProxyType({})


class CopyableFiles(Protocol):
    """Files that can be copied into a folder, as those of a scene."""

    def copy_to(self, folder: Path) -> None:
        """Copy every file into the folder."""
        ...


_NOTHING: Mapping[str, CopyableFiles] = MappingProxyType({})


class StoreWriter:
    """A store that runs are added to; made by `open_writer`.

    Attributes:
        path: local folder of its journal, table and scene; the store itself if that is local.
        identity: the sweep that it belongs to.
        done: ids of the runs that it held when it was opened.
        started: when it was opened.
    """

    def __init__(
        self, session: WriteSession, identity: SweepIdentity, done: Collection[str]
    ) -> None:
        self.path = session.folder
        self.identity = identity
        self.done = frozenset(done)
        self.started = _now()
        self._session = session
        self._journal = Journal(self.path / JOURNAL)
        self._notes: Journal | None = None

    @property
    def scene_folder(self) -> Path:
        """Local folder of the copied scene."""
        return self.path / SCENES / self.identity.scene_hash

    def append(self, rows: Sequence[bytes]) -> None:
        """Add finished runs, each a row as JSON; their traces must be stored already."""
        self._journal.append(rows)
        self._session.add_lines(JOURNAL, rows)

    def note(self, notes: Sequence[bytes]) -> None:
        """Keep results of a later pass, each as JSON, in case of an interruption."""
        self._notes = self._notes or Journal(self.path / NOTES)
        self._notes.append(notes)
        self._session.add_lines(NOTES, notes)

    def notes(self) -> Iterator[dict[str, Any]]:
        """Yield all notes, also those from before an interruption."""
        return read_lines(self.path / NOTES)

    def rows(self) -> Iterator[dict[str, Any]]:
        """Yield the rows of all finished runs."""
        return read_lines(self.path / JOURNAL)

    def finish(
        self,
        own: Sequence[Column],
        shared: Mapping[str, Any],
        provenance: Provenance,
        amendments: Mapping[str, Mapping[str, Any]] = _NO_AMENDMENTS,
    ) -> StoreManifest:
        """Publish the table, then the manifest, which makes the store finished.

        Args:
            own: columns of axes, metrics, settings and effects.
            shared: fields that all runs share.
            provenance: the program and machine that write.
            amendments: run id to values by column, from passes after the runs.

        Returns:
            The store's manifest: another writer's, if it has published the same sweep meanwhile.

        Raises:
            OutputError: something cannot be written; the store stays resumable.
        """
        self.close()
        amend_journal(self.path, amendments)
        write_table(self.path / JOURNAL, self.path / TABLE, own, shared)
        return self._session.publish(self._manifest(provenance))

    def close(self) -> None:
        """Leave the store as it is, resumable, once all rows are stored."""
        with ExitStack() as closing:
            closing.callback(self._session.flush)
            closing.callback(self._journal.close)
            if self._notes is not None:
                closing.callback(self._notes.close)

    def _manifest(self, provenance: Provenance) -> StoreManifest:
        return StoreManifest(
            sweep=self.identity,
            provenance=provenance,
            **count_outcomes(read_table(self.path / TABLE, OUTCOME_COLUMNS)),
            files={file.as_posix(): sha256_of(self.path / file) for file in self._files()},
            started=self.started,
            finished=_now(),
        )

    def _files(self) -> list[Path]:
        scenes = sorted(path for path in (self.path / SCENES).rglob("*") if path.is_file())
        files = [self.path / IDENTITY, self.path / TABLE, *scenes]
        return [path.relative_to(self.path) for path in files]


@contextmanager
def open_writer(
    address: Address,
    identity: SweepIdentity,
    scene: CopyableFiles,
    *,
    fresh: bool,
    retry_failed: bool = False,
    beside: Mapping[str, CopyableFiles] = _NOTHING,
) -> Generator[StoreWriter | StoreManifest]:
    """Yield a writer for a new or interrupted store, or the manifest of a finished one.

    Args:
        address: the store's address.
        identity: the sweep.
        scene: the scene's files.
        fresh: whether to remove an existing store.
        retry_failed: whether to remove failed runs, so that they are run again.
        beside: other files, by the name of their folder beside the scene's.

    Raises:
        OutputError: the place cannot be written, holds something else, or is in use.
        StoreError: it holds a store of another sweep.
    """
    backend = backend_at(address, OutputError)
    try:
        with backend.write_session() as session:
            if fresh:
                _refuse_foreign(backend, session, "not removed")
                session.clear()
            manifest = _find_manifest(backend)
            if manifest is not None:
                check_same_sweep(address, manifest.sweep, identity)
                session.remove_journal()
                if not (retry_failed and _reopen(session, manifest)):
                    yield manifest
                    return
            folders = {identity.scene_hash: scene, **beside}
            done = _prepare(backend, session, identity, folders, retry_failed=retry_failed)
            writer = StoreWriter(session, identity, done)
            try:
                yield writer
            except BaseException:
                # Workers that were killed in mid-write could not clean up after themselves.
                session.remove_temporaries()
                raise
            finally:
                writer.close()
    except OSError as error:
        raise write_error(error.filename or address, error) from error


def _find_manifest(backend: Backend) -> StoreManifest | None:
    """Return the manifest of a store; None if it is unfinished or not there.

    Raises:
        StoreError: the manifest is damaged or of another version.
    """
    data = backend.read(MANIFEST)
    return None if data is None else parse_manifest(data, backend.address)


def _prepare(
    backend: Backend,
    session: WriteSession,
    identity: SweepIdentity,
    folders: Mapping[str, CopyableFiles],
    *,
    retry_failed: bool,
) -> set[str]:
    """Make a new store, or mend an interrupted one; return the ids of the runs it holds."""
    stored = backend.read(IDENTITY)
    if stored is None:
        _refuse_foreign(backend, session, "choose another place with -o")
        session.remove_temporaries()
        _copy(folders, session.folder / SCENES)
        session.begin(identity)
        return set()
    check_same_sweep(backend.address, parse_identity(stored, backend.address), identity)
    session.remove_temporaries()
    _copy(folders, session.folder / SCENES)
    return _resume(backend, session, retry_failed=retry_failed)


def _copy(folders: Mapping[str, CopyableFiles], folder: Path) -> None:
    """Copy files into folders that do not exist."""
    for name, files in folders.items():
        if not (folder / name).is_dir():
            files.copy_to(folder / name)


def _resume(backend: Backend, session: WriteSession, *, retry_failed: bool) -> set[str]:
    session.fetch_journal()
    mend_notes(session.folder)
    if retry_failed:
        backend.delete(failed_traces(session.folder))
        drop_failed_rows(session.folder)

    def is_complete(row: Mapping[str, Any]) -> bool:
        name = row["trace_file"]
        return name is None or backend.trace_size(name) == row["trace_bytes"]

    done = mend_journal(session.folder, is_complete)
    session.replace_journal()
    return done


def _reopen(session: WriteSession, manifest: StoreManifest) -> bool:
    """Make a finished store with failed runs an unfinished one; return whether it has any.

    The rows are in the journal before the manifest goes, so that the store is one or the other at
    any time.

    Raises:
        StoreError: its table is damaged, or it has no traces.
        OutputError: the journal cannot be written.
    """
    session.fetch_table()
    table = session.folder / TABLE
    statuses = read_table(table, ["status"])["status"].unique().to_pylist()
    if FAILED_STATUSES.isdisjoint(statuses):
        return False
    if manifest.traces_left_out:
        raise StoreError(
            f"{session.folder} is a baseline without traces; sweep again elsewhere with -o"
        )
    with atomic_write(session.folder / JOURNAL, durable=True) as path, path.open("wb") as journal:
        journal.writelines(json.dumps(row).encode() + b"\n" for row in iterate_rows(table))
    session.unpublish()
    return True


def _refuse_foreign(backend: Backend, session: WriteSession, remedy: str) -> None:
    if foreign := session.foreign_names():
        names = ", ".join(foreign[:3])
        raise OutputError(f"{backend.address} holds other files ({names}); {remedy}")


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")
