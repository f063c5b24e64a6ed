"""Write a store so that it can be interrupted at any point and resumed by the same command."""

import fcntl
import os
import shutil
import stat
from collections.abc import Collection, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol

from contactlab.errors import OutputError
from contactlab.schema import Provenance, StoreManifest, SweepIdentity
from contactlab.store.atomic_files import (
    TEMPORARY_SUFFIX,
    atomic_write,
    sha256_of,
    sync_filesystem,
    write_error,
)
from contactlab.store.retry_failed import drop_failed, reopen
from contactlab.store.row_journal import (
    JOURNAL,
    NOTES,
    Journal,
    amend_journal,
    mend_journal,
    mend_notes,
    read_lines,
)
from contactlab.store.runs_table import (
    OUTCOME_COLUMNS,
    TABLE,
    count_outcomes,
    read_table,
    write_table,
)
from contactlab.store.store_address import Address, ObjectAddress
from contactlab.store.store_manifest import (
    IDENTITY,
    MANIFEST,
    check_same_sweep,
    read_identity,
    read_manifest,
)
from contactlab.store.table_layout import Column

SCENES = "scenes"
TRACES = "traces"
_LOCK = ".lock"
NOTHING: Mapping[str, Mapping[str, Any]] = MappingProxyType({})
_OWN = {SCENES, TRACES, _LOCK, JOURNAL, NOTES, TABLE, IDENTITY, MANIFEST}


class SceneFiles(Protocol):
    """The files of a scene."""

    def copy_to(self, folder: Path) -> None:
        """Copy every file into the folder."""
        ...


class StoreWriter:
    """A store that runs are added to; made by `writing`.

    Attributes:
        path: its folder.
        identity: what its runs are asked to be.
        done: ids of the runs that it held when it was opened.
        started: when it was opened.
    """

    def __init__(self, path: Path, identity: SweepIdentity, done: Collection[str]) -> None:
        self.path = path
        self.identity = identity
        self.done = frozenset(done)
        self.started = _now()
        self._journal = Journal(path)
        self._notes: Journal | None = None

    @property
    def scene_folder(self) -> Path:
        """Where the copied scene's files are."""
        return self.path / SCENES / self.identity.scene_hash

    def append(self, rows: Sequence[bytes]) -> None:
        """Add finished runs, each a row as JSON; their traces must be in place."""
        self._journal.append(rows)

    def note(self, rows: Sequence[bytes]) -> None:
        """Keep what was found out of finished runs, each as JSON, in case of an interruption."""
        self._notes = self._notes or Journal(self.path, NOTES)
        self._notes.append(rows)

    def notes(self) -> Iterator[dict[str, Any]]:
        """Yield what was noted, also before an interruption."""
        return read_lines(self.path / NOTES)

    def rows(self) -> Iterator[dict[str, Any]]:
        """Yield the rows of finished runs."""
        return read_lines(self.path / JOURNAL)

    def finish(
        self,
        own: Sequence[Column],
        shared: Mapping[str, Any],
        provenance: Provenance,
        found: Mapping[str, Mapping[str, Any]] = NOTHING,
    ) -> StoreManifest:
        """Publish the table, then the manifest; from then on the store is whole.

        Args:
            own: columns of axes, metrics, settings and effects.
            shared: what all runs have in common.
            provenance: what writes.
            found: run id to values by column, found out after the run was added.

        Raises:
            OutputError: something cannot be written; the store stays resumable.
        """
        self.close()
        amend_journal(self.path, found)
        write_table(self.path / JOURNAL, self.path / TABLE, own, shared)
        sync_filesystem(self.path)
        manifest = self._manifest(provenance)
        with atomic_write(self.path / MANIFEST, durable=True) as temporary:
            temporary.write_text(manifest.model_dump_json(indent=2) + "\n", encoding="utf-8")
        for name in (JOURNAL, NOTES):
            (self.path / name).unlink(missing_ok=True)
        return manifest

    def close(self) -> None:
        """Leave the store as it is, resumable."""
        with ExitStack() as closing:
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
        scene = sorted(path for path in self.scene_folder.rglob("*") if path.is_file())
        files = [self.path / IDENTITY, self.path / TABLE, *scene]
        return [path.relative_to(self.path) for path in files]


@contextmanager
def open_writer(
    path: Address,
    identity: SweepIdentity,
    scene: SceneFiles,
    *,
    fresh: bool,
    retry_failed: bool = False,
) -> Generator[StoreWriter | StoreManifest]:
    """Yield a writer for a new or interrupted store, or the manifest of a finished one.

    Args:
        path: the store's folder, or where it lies in object storage.
        identity: what the runs are asked to be.
        scene: copies the scene's files into a folder.
        fresh: whether to remove a store that is there.
        retry_failed: whether to take failed runs out of it, as if they had not been run.

    Raises:
        OutputError: the folder cannot be written, holds something else, or is in use.
        StoreError: the folder holds a store of another sweep.
    """
    try:
        if isinstance(path, ObjectAddress):
            # It builds on this file.
            from contactlab.store.objects import writing_objects  # noqa: PLC0415

            asked = {"fresh": fresh, "retry_failed": retry_failed}
            with writing_objects(path, identity, scene, **asked) as opened:
                yield opened
            return
        path.mkdir(parents=True, exist_ok=True)
        with _locked(path):
            if fresh:
                _clear(path)
            if (path / MANIFEST).is_file():
                finished = read_manifest(path)
                check_same_sweep(path, finished.sweep, identity)
                for name in (JOURNAL, NOTES, JOURNAL + TEMPORARY_SUFFIX):
                    (path / name).unlink(missing_ok=True)
                if not (retry_failed and reopen(path, finished)):
                    yield finished
                    return
            done = _prepare(path, identity, scene, retry_failed=retry_failed)
            writer = StoreWriter(path, identity, done)
            try:
                yield writer
            except BaseException:
                # Workers that were stopped in mid-write could not clean up after themselves.
                _remove_leftovers(path)
                raise
            finally:
                writer.close()
    except OSError as error:
        raise write_error(error.filename or path, error) from error


def _prepare(
    path: Path, identity: SweepIdentity, scene: SceneFiles, *, retry_failed: bool
) -> set[str]:
    """Make a new store, or mend an interrupted one; return the ids of the runs it holds."""
    if (path / IDENTITY).is_file():
        check_same_sweep(path, read_identity(path), identity)
        _remove_leftovers(path)
        mend_notes(path)
        if retry_failed:
            drop_failed(path)
        return mend_journal(path, lambda row: _has_trace(path, row))
    _refuse_strangers(path, "choose another folder with -o")
    _remove_leftovers(path)
    (path / TRACES).mkdir(exist_ok=True)
    scene.copy_to(path / SCENES / identity.scene_hash)
    with atomic_write(path / IDENTITY) as temporary:
        temporary.write_text(identity.model_dump_json(indent=2) + "\n", encoding="utf-8")
    return set()


def _has_trace(path: Path, row: Mapping[str, Any]) -> bool:
    if row["trace_file"] is None:
        return True
    try:
        found = os.stat(f"{path}/{row['trace_file']}")  # noqa: PTH116 - a million, in half the time
    except (FileNotFoundError, NotADirectoryError):
        return False
    return stat.S_ISREG(found.st_mode) and found.st_size == row["trace_bytes"]


def _clear(path: Path) -> None:
    _refuse_strangers(path, "not removed")
    # The manifest goes first: a half-removed store must not look whole.
    for name in (MANIFEST, IDENTITY, TABLE, JOURNAL, NOTES):
        (path / name).unlink(missing_ok=True)
    for name in (SCENES, TRACES):
        shutil.rmtree(path / name, ignore_errors=True)


def _refuse_strangers(path: Path, remedy: str) -> None:
    own = _OWN | {name + TEMPORARY_SUFFIX for name in _OWN}
    strangers = sorted({each.name for each in path.iterdir()} - own)
    if strangers:
        raise OutputError(f"{path} holds other files ({', '.join(strangers[:3])}); {remedy}")


def _remove_leftovers(path: Path) -> None:
    for name in (MANIFEST, IDENTITY, TABLE, JOURNAL):
        (path / (name + TEMPORARY_SUFFIX)).unlink(missing_ok=True)
    for leftover in (path / TRACES).rglob("*" + TEMPORARY_SUFFIX):
        leftover.unlink()


@contextmanager
def _locked(path: Path) -> Generator[None]:
    """Keep a second sweep out; the lock goes with the process that holds it."""
    with (path / _LOCK).open("a") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise OutputError(f"{path} is in use by another sweep; wait or use -o") from error
        yield


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")
