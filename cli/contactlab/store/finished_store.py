"""Read a finished store."""

from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import pyarrow as pa

from contactlab.errors import StoreError, did_you_mean
from contactlab.schema import EvidenceRecord, StoreManifest, TraceFile
from contactlab.store.mcap import StoredTrace, read_trace
from contactlab.store.objects import fetched_store, fetched_trace
from contactlab.store.run_columns import RunColumns
from contactlab.store.runs_table import TABLE, read_table, shared_fields
from contactlab.store.store_address import Address, ObjectAddress, parse_address
from contactlab.store.store_manifest import read_manifest
from contactlab.store.store_writer import SCENES
from contactlab.store.table_layout import row_to_record


def open(address: str | Address) -> "Store":  # noqa: A001 - read as evidence.open
    """Open a finished store.

    Args:
        address: its folder, or where it lies in object storage: `s3://bucket/prefix`.

    Raises:
        StoreError: there is none, it is unfinished, damaged or of another version.
    """
    return Store.open(parse_address(address))


@dataclass(frozen=True)
class Store:
    """A finished store.

    Attributes:
        path: the folder with all that it holds but its traces; they are there too, if the store
            itself is a folder.
        manifest: what it holds.
        address: where it is.
    """

    path: Path
    manifest: StoreManifest
    address: Address

    @classmethod
    def open(cls, address: Address) -> "Store":
        """Open a store; one in object storage is fetched but for its traces.

        Raises:
            StoreError: there is none, it is unfinished, damaged or of another version.
        """
        path = fetched_store(address) if isinstance(address, ObjectAddress) else address
        return cls(path, read_manifest(path), address)

    @cached_property
    def table(self) -> pa.Table:
        """Every run as a row, in plan order; units are in the fields' metadata."""
        return read_table(self.path / TABLE, named=self.address / TABLE)

    @cached_property
    def columns(self) -> RunColumns:
        """The same table column by column, as NumPy arrays."""
        return RunColumns(self.path, self.address)

    @property
    def units(self) -> dict[str, str]:
        """The unit of every column that holds numbers; `1` for counts and ratios."""
        told = {field.name: (field.metadata or {}).get(b"unit") for field in self.table.schema}
        return {name: unit.decode() for name, unit in told.items() if unit}

    @property
    def scene_folder(self) -> Path:
        """Where the scene's files are."""
        return self.path / SCENES / self.manifest.sweep.scene_hash

    def records(self) -> Iterator[EvidenceRecord]:
        """Yield every run's record, in plan order."""
        shared = shared_fields(self.table.schema)
        for batch in self.table.to_batches(max_chunksize=1024):
            for row in batch.to_pylist():
                yield row_to_record(row, shared)

    def record(self, run: str) -> EvidenceRecord:
        """Return the record of a run, by its id or the start of it.

        Raises:
            StoreError: no run or more than one has this id.
        """
        ids: list[str] = self.columns.to_pydict(["run_id"])["run_id"]
        found = [run_id for run_id in ids if run_id.startswith(run)]
        if not found:
            hint = did_you_mean(run, ids)
            raise StoreError(f"no run in {self.address} has an id that starts with '{run}'{hint}")
        if len(found) > 1:
            raise StoreError(
                f"{len(found)} runs in {self.address} have ids that start with '{run}' "
                f"({', '.join(found[:3])}, ...); write more of it"
            )
        return row_to_record(self.columns.row(ids.index(found[0])), self.columns.shared)

    def trace(self, run: EvidenceRecord | str) -> StoredTrace:
        """Return the stored trace of a run, by its record, its id or the start of it.

        Raises:
            StoreError: no such run, or none was kept, or it is damaged.
        """
        record = self.record(run) if isinstance(run, str) else run
        if record.trace is None:
            raise StoreError(
                f"no trace of run {record.run_id} was kept; sweep again with --set trace=all "
                "into another store"
            )
        if self.manifest.traces_left_out:
            raise StoreError(
                f"{self.address} is a baseline without traces; its sweep's store has them"
            )
        with self.trace_file(record.trace) as path:
            return read_trace(path, self.address / record.trace.file)

    @contextmanager
    def trace_file(self, trace: TraceFile) -> Generator[Path]:
        """Yield the file of a trace; one in object storage is fetched, and goes with the context.

        Raises:
            StoreError: it cannot be fetched.
        """
        if isinstance(self.address, Path):
            yield self.address / trace.file
            return
        with fetched_trace(self.address, trace.file) as path:
            yield path
