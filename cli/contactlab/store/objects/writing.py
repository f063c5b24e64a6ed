"""Write a store in object storage, so that it can be interrupted anywhere and resumed anywhere.

Journal, notes, table and scene are made in a folder of this machine, as for any store. What must
outlive this process is put into the bucket as it comes: traces by the workers, rows and notes,
batch by batch, as objects of their own.
"""

from collections.abc import Collection, Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from contactlab.errors import OutputError
from contactlab.schema import Provenance, StoreManifest, SweepIdentity
from contactlab.store.objects.object_client import ObjectClient, connect
from contactlab.store.objects.outbox import Outbox
from contactlab.store.objects.resuming import (
    FOUND,
    ROWS,
    keep_rows,
    pull_notes,
    pull_rows,
)
from contactlab.store.objects.store_lease import LOCK, StoreLease, hold_lease
from contactlab.store.retry_failed import reopen
from contactlab.store.row_journal import JOURNAL
from contactlab.store.runs_table import TABLE
from contactlab.store.store_address import ObjectAddress
from contactlab.store.store_manifest import IDENTITY, MANIFEST, check_same_sweep, parse_document
from contactlab.store.store_writer import NOTHING, SCENES, TRACES, SceneFiles, StoreWriter
from contactlab.store.table_layout import Column

_OWN = {SCENES, TRACES, LOCK, ROWS, FOUND, TABLE, IDENTITY, MANIFEST}


class ObjectWriter(StoreWriter):
    """A store in object storage that runs are added to; made by `writing_objects`.

    Its path is the folder of this machine where journal, notes and table are made.
    """

    def __init__(
        self,
        path: Path,
        identity: SweepIdentity,
        done: Collection[str],
        client: ObjectClient,
        lease: StoreLease,
    ) -> None:
        super().__init__(path, identity, done)
        self._client = client
        self._lease = lease
        self._outbox = Outbox(client)

    def append(self, rows: Sequence[bytes]) -> None:
        """Add finished runs, each a row as JSON; their traces must be in place."""
        self._lease.check()
        super().append(rows)
        self._outbox.send(ROWS, _lines(rows))

    def note(self, rows: Sequence[bytes]) -> None:
        """Keep what was found out of finished runs, each as JSON, in case of an interruption."""
        self._lease.check()
        super().note(rows)
        self._outbox.send(FOUND, _lines(rows))

    def finish(
        self,
        own: Sequence[Column],
        shared: Mapping[str, Any],
        provenance: Provenance,
        found: Mapping[str, Mapping[str, Any]] = NOTHING,
    ) -> StoreManifest:
        """Publish the table, then the manifest; from then on the store is whole.

        Where another sweep has published meanwhile, what it wrote is kept. See `StoreWriter`.
        """
        manifest = super().finish(own, shared, provenance, found)
        there = _finished(self._client, self.identity)
        if there is None:
            self._publish()
        _remove_batches(self._client)
        return there or manifest

    def _publish(self) -> None:
        self._lease.renew()
        self._client.put(TABLE, self.path / TABLE)
        data = (self.path / MANIFEST).read_bytes()
        if self._client.create(MANIFEST, data) is None:
            # Another sweep has published since the lock was renewed, and our table now lies beside
            # its manifest: what lies there must belong together.
            self._client.put(MANIFEST, data)

    def close(self) -> None:
        """Leave the store as it is, resumable, once all rows are there."""
        try:
            super().close()
        finally:
            self._outbox.close()


@contextmanager
def writing_objects(
    address: ObjectAddress,
    identity: SweepIdentity,
    scene: SceneFiles,
    *,
    fresh: bool,
    retry_failed: bool = False,
) -> Generator[StoreWriter | StoreManifest]:
    """Yield a writer for a new or interrupted store, or the manifest of a finished one.

    Args:
        address: where the store lies.
        identity: what the runs are asked to be.
        scene: copies the scene's files into a folder.
        fresh: whether to remove a store that is there.
        retry_failed: whether to take failed runs out of it, as if they had not been run.

    Raises:
        OutputError: it cannot be written, there is something else, or it is in use.
        StoreError: there is a store of another sweep.
    """
    client = connect(address, OutputError)
    with hold_lease(client) as lease, TemporaryDirectory(prefix="contactlab-") as name:
        folder = Path(name)
        if fresh:
            _clear(client)
        if (manifest := _finished(client, identity)) is not None:
            _remove_batches(client)
            if not (retry_failed and _reopen(client, folder, manifest)):
                yield manifest
                return
        done = _prepare(client, folder, identity, scene, retry_failed=retry_failed)
        writer = ObjectWriter(folder, identity, done, client, lease)
        try:
            yield writer
        finally:
            writer.close()


def _finished(client: ObjectClient, identity: SweepIdentity) -> StoreManifest | None:
    """Return the manifest of a store that is finished."""
    found = client.find(MANIFEST)
    if found is None:
        return None
    manifest = parse_document(found.data, StoreManifest, client.address / MANIFEST)
    check_same_sweep(client.address, manifest.sweep, identity)
    return manifest


def _reopen(client: ObjectClient, folder: Path, manifest: StoreManifest) -> bool:
    """Make a finished store that holds failed runs an unfinished one; return whether it holds any.

    Its rows are there again before its manifest goes, so that it is one or the other at any time.
    """
    (folder / MANIFEST).write_text(manifest.model_dump_json(), encoding="utf-8")
    client.fetch(TABLE, folder / TABLE)
    if not reopen(folder, manifest):
        return False
    keep_rows(client, folder / JOURNAL)
    client.delete([MANIFEST])
    client.delete([TABLE])
    return True


def _prepare(
    client: ObjectClient,
    folder: Path,
    identity: SweepIdentity,
    scene: SceneFiles,
    *,
    retry_failed: bool,
) -> set[str]:
    """Make a new store, or mend an interrupted one; return the ids of the runs it holds."""
    scene.copy_to(folder / SCENES / identity.scene_hash)
    text = identity.model_dump_json(indent=2) + "\n"
    found = client.find(IDENTITY)
    if found is not None:
        there = parse_document(found.data, SweepIdentity, client.address / IDENTITY)
        check_same_sweep(client.address, there, identity)
        (folder / IDENTITY).write_bytes(found.data)
        pull_notes(client, folder)
        return pull_rows(client, folder, retry_failed=retry_failed)
    _refuse_strangers(client, "choose another prefix with -o")
    (folder / IDENTITY).write_text(text, encoding="utf-8")
    for file in sorted(path for path in (folder / SCENES).rglob("*") if path.is_file()):
        client.put(file.relative_to(folder).as_posix(), file)
    client.put(IDENTITY, text.encode())
    return set()


def _clear(client: ObjectClient) -> None:
    _refuse_strangers(client, "not removed")
    # The manifest goes first: a half-removed store must not look whole.
    for name in (MANIFEST, IDENTITY):
        client.delete([name])
    client.delete([name for name, _ in client.sizes() if name != LOCK])


def _remove_batches(client: ObjectClient) -> None:
    for folder in (ROWS, FOUND):
        client.delete([name for name, _ in client.sizes(folder)])


def _refuse_strangers(client: ObjectClient, remedy: str) -> None:
    if strangers := sorted(client.top() - _OWN):
        raise OutputError(
            f"{client.address} holds other objects ({', '.join(strangers[:3])}); {remedy}"
        )


def _lines(rows: Sequence[bytes]) -> bytes:
    return b"".join(row + b"\n" for row in rows)
