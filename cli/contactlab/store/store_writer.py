"""Writes a store so that it can be interrupted at any point and resumed by the same command.

Rows go to a journal as runs finish; the table follows at the end, and the manifest comes last.
"""

import shutil
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any, Protocol

from contactlab.errors import OutputError, StoreError
from contactlab.schema.evidence import Provenance, StoreManifest, SweepIdentity
from contactlab.store.atomic_files import hashes_below, sha256_of, write_errors
from contactlab.store.backend import Backend, WriteSession
from contactlab.store.folder_backend import backend_at
from contactlab.store.row_journal import (
    FAILED_STATUSES,
    IsPlanned,
    ResumedRows,
    Row,
    amend_journal,
    encode_lines,
    end_torn_line,
    read_lines,
    repair_journal,
    write_journal,
)
from contactlab.store.run_columns import RunColumns
from contactlab.store.runs_table import (
    OUTCOME_COLUMNS,
    Digests,
    count_outcomes,
    iterate_rows,
    merge_tables,
    write_table,
)
from contactlab.store.store_files import (
    IDENTITY,
    JOURNAL,
    MANIFEST,
    NOTES,
    SCENES,
    TABLE,
    Address,
    check_same_sweep,
    chooses_alike,
    is_covered,
    parse_identity,
    parse_manifest,
    shard_of,
    time_now,
)
from contactlab.store.table_layout import Column
from contactlab.store.verify_store import find_problems

_NO_FIELDS: Mapping[str, Any] = MappingProxyType({})
Conclusion = Callable[[RunColumns], Mapping[str, Any]]
"""Returns fields of a manifest from the runs of its table."""


class CopyableFiles(Protocol):
    """Files that can be copied into a folder, such as those of a scene."""

    def copy_to(self, folder: Path) -> None:
        """Copy every file into the folder."""
        ...


class StoreWriter:
    """A store that runs are added to; made by `open_writer`."""

    def __init__(
        self, session: WriteSession, identity: SweepIdentity, finished_ids: frozenset[str]
    ) -> None:
        # Local folder of its journal, table and scene; the store itself if that is local.
        self.path = session.folder
        self.identity = identity
        # Ids of the runs in the store when it was opened.
        self.done = finished_ids
        self.started = time_now()
        self._session = session
        self._files = {JOURNAL: (self.path / JOURNAL).open("ab")}

    @property
    def scene_folder(self) -> Path:
        """Local folder of the copied scene."""
        return self.path / SCENES / self.identity.scene_hash

    def append_rows(self, rows: Sequence[bytes], shared: bytes = b"") -> None:
        """Add finished runs as JSON rows, and their shared fields; their traces must exist."""
        self._add_lines(JOURNAL, encode_lines(rows, shared))

    def write_notes(self, notes: Sequence[bytes]) -> None:
        """Keep results of a later pass, each as JSON, in case of an interruption."""
        self._add_lines(NOTES, encode_lines(notes, b""))

    def _add_lines(self, name: str, lines: Sequence[bytes]) -> None:
        with write_errors(self.path / name):
            if name not in self._files:
                self._files[name] = (self.path / name).open("ab")
            self._files[name].writelines(lines)
            self._files[name].flush()
        self._session.add_lines(name, lines)

    def read_notes(self) -> Iterator[dict[str, Any]]:
        """Yield all notes, including those from before an interruption."""
        return read_lines(self.path / NOTES)

    def read_rows(self) -> Iterator[dict[str, Any]]:
        """Yield the rows of all finished runs."""
        return read_lines(self.path / JOURNAL)

    def finish_store(
        self,
        own: Sequence[Column],
        shared: Mapping[str, Any],
        provenance: Provenance,
        amendments: Mapping[str, Mapping[str, Any]] = _NO_FIELDS,
        identity: SweepIdentity | None = None,
        concluded: Conclusion = lambda _: {},
    ) -> StoreManifest:
        """Publish the table, then the manifest, which makes the store finished.

        Besides its own columns and the fields that all runs share, the table has amendments from
        passes after the runs: run id to values by column. An identity replaces the first one, if
        the number of runs was not known then. `concluded` returns fields of the manifest that
        depend on all runs of the table. The returned manifest is another writer's, if that has
        published the same sweep meanwhile. After an OutputError the store stays resumable.
        """
        self.close()
        amend_journal(self.path, amendments)
        times = self.started, time_now()
        all_fields = {**shared, **_shared_fields(provenance, times)}
        digests = write_table(self.path / JOURNAL, self.path / TABLE, own, all_fields)
        if identity:
            self.identity = identity
            self._session.begin_store(identity)
        return self._publish_manifest(digests, provenance, times, concluded)

    def join_tables(
        self,
        tables: Mapping[Address, Path],
        provenance: Provenance,
        times: tuple[str, str],
        concluded: Conclusion,
    ) -> StoreManifest:
        """Publish a table with all rows of other tables, then the manifest; see `finish`."""
        self.close()
        shared_fields = _shared_fields(provenance, times)
        digests = merge_tables(tables, self.path / TABLE, shared_fields)
        return self._publish_manifest(digests, provenance, times, concluded)

    def _publish_manifest(
        self,
        digests: Digests,
        provenance: Provenance,
        times: tuple[str, str],
        concluded: Conclusion,
    ) -> StoreManifest:
        files = {name: sha256_of(self.path / name) for name in (IDENTITY, TABLE)}
        scenes = hashes_below(self.path / SCENES).items()
        columns = RunColumns(self.path)
        manifest = StoreManifest(
            sweep=self.identity,
            provenance=provenance,
            **count_outcomes(columns.iterate_batches(OUTCOME_COLUMNS)),
            **concluded(columns),
            files=files | {f"{SCENES}/{name}": sha256 for name, sha256 in scenes},
            records=digests.records,
            physics=digests.physics,
            started=times[0],
            finished=times[1],
        )
        return self._session.publish_store(manifest)

    def discard_store(self) -> None:
        """Remove the store, which has no runs."""
        self.close()
        self._session.clear_store()

    def close(self) -> None:
        """Close the store, still resumable, after all rows are stored."""
        try:
            for name, file in self._files.items():
                with write_errors(self.path / name):
                    file.close()
        finally:
            self._session.flush_lines()


def _shared_fields(provenance: Provenance, times: tuple[str, str]) -> dict[str, Any]:
    started, finished = times
    return {"provenance": provenance.model_dump(), "started": started, "finished": finished}


@contextmanager
def open_writer(
    address: Address,
    identity: SweepIdentity,
    scene: CopyableFiles,
    *,
    fresh: bool,
    retry_failed: bool = False,
    repair: bool = False,
    is_planned: IsPlanned = lambda _run_id, _index: True,
    more_files: Mapping[str, CopyableFiles] = _NO_FIELDS,
) -> Generator[StoreWriter | StoreManifest]:
    """Yield a writer for a new or interrupted store, or the manifest of a finished one.

    An existing store can be removed, and its failed or damaged runs can be run again. `more_files`
    lists other files by the name of their folder next to the scene's. Raises an OutputError if the
    place cannot be written, holds something else, or is in use; a StoreError if it holds a store of
    another sweep, or a damaged one.
    """
    backend = backend_at(address, OutputError)
    rows = ResumedRows(backend, identity, is_planned, retry_failed, repair)
    with write_errors(address, within=True), backend.write_session() as session:
        if fresh:
            _refuse_foreign(backend, "not removed")
            session.clear_store()
        manifest = _find_manifest(rows)
        if manifest is not None:
            check_same_sweep(address, manifest.sweep, identity)
            session.remove_journal()
            rows_to_keep = _rows_to_keep(rows, session, manifest)
            if rows_to_keep is None and not is_covered(manifest.sweep, identity):
                rows_to_keep = iterate_rows(session.table_file())
            if rows_to_keep is None:
                yield manifest
                return
            # The rows are in the journal before the manifest goes: a kill leaves one of both.
            if manifest.traces_left_out:
                raise StoreError(
                    f"{session.folder} is a baseline without traces; sweep again elsewhere with -o"
                )
            write_journal(session.folder / JOURNAL, rows_to_keep)
            session.reopen_store()
        run_ids = _prepare_store(rows, session, {identity.scene_hash: scene, **more_files})
        writer = StoreWriter(session, identity, run_ids)
        try:
            yield writer
        except BaseException:
            # Workers killed during a write could not clean up after themselves.
            session.remove_temporaries()
            raise
        finally:
            writer.close()


def _find_manifest(rows: ResumedRows) -> StoreManifest | None:
    """Return a store's manifest, None if it has none; with `repair` a damaged one is removed."""
    backend = rows.backend
    data = backend.read_file(MANIFEST)
    try:
        return None if data is None else parse_manifest(data, backend.address)
    except StoreError:
        stored = backend.read_file(IDENTITY)
        if not rows.repair or stored is None:
            raise
        check_same_sweep(backend.address, parse_identity(stored, backend.address), rows.identity)
        backend.delete_files([MANIFEST])
        return None


def _prepare_store(
    rows: ResumedRows, session: WriteSession, folders: Mapping[str, CopyableFiles]
) -> frozenset[str]:
    """Make a new store, or repair an interrupted one. Return the ids of its runs."""
    address, folder = rows.backend.address, session.folder
    stored, stored_identity = rows.backend.read_file(IDENTITY), None
    if stored is None:
        _refuse_foreign(rows.backend, "choose another place with -o")
    else:
        try:
            stored_identity = parse_identity(stored, address)
        except StoreError as error:
            if not rows.repair:
                message = f"{error}; add --repair to keep the valid runs, or --fresh to start over"
                raise StoreError(message) from error
        else:
            if rows.repair:
                # Only its definitions must be the same.
                stored_identity = rows.identity.model_copy(
                    update={"definitions": stored_identity.definitions}
                )
            check_same_sweep(address, stored_identity, rows.identity)
    session.fetch_journal()
    has_lines = (folder / JOURNAL).is_file() and (folder / JOURNAL).stat().st_size > 0
    if stored is None and not rows.repair and has_lines:
        raise StoreError(
            f"{address} has runs but no {IDENTITY}, so their sweep is unknown; add --repair to "
            "keep those that this sweep plans, or --fresh to start over"
        )
    is_begun = stored_identity is not None and not rows.repair
    for name, files in folders.items():
        _copy_files(files, folder / SCENES / name, is_begun=is_begun)
    continues = (
        stored_identity is not None
        and is_begun
        and (stored_identity.whole is None or shard_of(stored_identity) is not None)
        and chooses_alike(stored_identity, rows.identity)
    )
    if not continues:
        session.begin_store(rows.identity)
    end_torn_line(folder / NOTES)
    run_ids = repair_journal(
        folder, rows.check_row, rows.keeps_run, repair=rows.repair, shown_path=address / JOURNAL
    )
    if rows.repair:
        trace_names = {row.get("trace_file") for row in read_lines(folder / JOURNAL)}
        rows.backend.delete_files(
            name for name in rows.backend.trace_names() if name not in trace_names
        )
    session.replace_journal()
    return run_ids


def _copy_files(files: CopyableFiles, folder: Path, *, is_begun: bool) -> None:
    """Copy files into a folder, unless it already contains them."""
    if folder.is_dir():
        with TemporaryDirectory() as again:
            files.copy_to(Path(again))
            if hashes_below(folder) == hashes_below(Path(again)):
                return
        if is_begun:
            raise StoreError(
                f"{folder} was changed since its runs began; add --repair to copy it again"
            )
        shutil.rmtree(folder)
    files.copy_to(folder)


def _rows_to_keep(
    rows: ResumedRows, session: WriteSession, manifest: StoreManifest
) -> Iterable[Row] | None:
    """Return the rows of a finished store with damaged or failed runs; None if it has none."""
    if rows.repair and find_problems(rows.backend.address):
        # In a changed table, no row is known to be valid.
        table = session.table_file()
        is_sound = table.is_file() and sha256_of(table) == manifest.files.get(TABLE)
        return iterate_rows(table) if is_sound else ()
    if rows.retry_failed and not FAILED_STATUSES.isdisjoint(manifest.statuses):
        return iterate_rows(session.table_file())
    return None


def _refuse_foreign(backend: Backend, remedy: str) -> None:
    if foreign := backend.foreign_names():
        names = ", ".join(foreign[:3])
        raise OutputError(f"{backend.address} holds other files ({names}); {remedy}")
