"""A store in a bucket, and what is put there."""

import contextlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from contactlab.errors import OutputError
from contactlab.schema import EvidenceRecord, StoreManifest
from contactlab.store import ObjectAddress, StoreWriter, open_writer, parse_address, record_to_row
from contactlab.store.objects import ObjectClient, connect


@dataclass
class Kit:
    """An address, what is written there, and a client to look at it."""

    address: ObjectAddress
    folder: Path
    client: ObjectClient
    records: Sequence[EvidenceRecord]
    identity: Any
    finish: Callable[[StoreWriter], StoreManifest]
    scene: Any

    def opened(
        self, *, fresh: bool = False, retry_failed: bool = False
    ) -> contextlib.AbstractContextManager[StoreWriter | StoreManifest]:
        identity = self.identity(len(self.records))
        return open_writer(
            self.address, identity, self.scene, fresh=fresh, retry_failed=retry_failed
        )

    def add(self, store: StoreWriter | StoreManifest, *places: int) -> None:
        """Put traces, as a worker does, then rows."""
        assert isinstance(store, StoreWriter)
        for place in places:
            self.put_trace(place)
            store.append([self.row(place)])

    def put_trace(self, place: int) -> None:
        trace = self.records[place].trace
        assert trace is not None
        self.client.put(trace.file, self.folder / trace.file)

    def row(self, place: int) -> bytes:
        return json.dumps(record_to_row(self.records[place])).encode()

    def write(self, *places: int, fresh: bool = False) -> StoreManifest:
        """Go on with some runs and finish."""
        with self.opened(fresh=fresh) as store:
            self.add(store, *places)
            assert isinstance(store, StoreWriter)
            return self.finish(store)

    def interrupt(self, *places: int) -> None:
        with contextlib.suppress(KeyboardInterrupt), self.opened() as store:
            self.add(store, *places)
            raise KeyboardInterrupt

    def done(self) -> frozenset[str]:
        """Return what a resumed sweep finds done, and leave it so."""
        with contextlib.suppress(KeyboardInterrupt), self.opened() as store:
            assert isinstance(store, StoreWriter)
            found = store.done
            raise KeyboardInterrupt
        return found  # pyright: ignore[reportPossiblyUnboundVariable]

    def ids(self, *places: int) -> set[str]:
        return {self.records[place].run_id for place in places}

    def names(self) -> set[str]:
        return {name for name, _ in self.client.sizes()}


@pytest.fixture
def kit(  # noqa: PLR0917 - one a fixture
    bucket: str,
    tmp_path: Path,
    record_of: Any,
    identity_of: Any,
    columns_of: Any,
    shared_part: Any,
    scene_file: Any,
    write_run_to: Any,
) -> Kit:
    address = parse_address(f"{bucket}/some/store")
    assert isinstance(address, ObjectAddress)
    records = [write_run_to(tmp_path / "made", record_of(index)) for index in range(3)]

    def finish(store: StoreWriter) -> StoreManifest:
        provenance = records[0].provenance
        return store.finish(columns_of(records), shared_part(records[0]), provenance)

    client = connect(address, OutputError)
    return Kit(address, tmp_path / "made", client, records, identity_of, finish, scene_file)
