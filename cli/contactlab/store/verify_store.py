"""Check a store: every file against its hash, every record against its schema, every trace."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
from pydantic import ValidationError

from contactlab.errors import StoreError
from contactlab.schema.evidence import RECORD_VERSION, EvidenceRecord, TraceFile
from contactlab.store.atomic_files import sha256_of
from contactlab.store.backend_protocol import IDENTITY, MANIFEST, TABLE, Backend
from contactlab.store.finished_store import Store
from contactlab.store.mcap.mcap_check import check_trace
from contactlab.store.runs_table import OUTCOME_COLUMNS, count_outcomes, read_table
from contactlab.store.store_access import backend_at
from contactlab.store.store_address import Address
from contactlab.store.store_files import stored_file
from contactlab.store.store_manifest import parse_identity


def verify(address: Address, *, thorough: bool = True) -> list[str]:
    """Return the defects of a store; none if it is sound.

    Args:
        address: the store's address.
        thorough: whether to check every record against its schema and every trace's bytes; if
            not, only that traces exist and have their size.

    Raises:
        StoreError: it cannot be opened at all.
    """
    store = Store.open(address)
    backend = backend_at(address, StoreError)
    check = _check_records if thorough else _check_columns
    return [*_check_files(store, backend), *_check_identity(store), *check(store, backend)]


def _check_files(store: Store, backend: Backend) -> Iterator[str]:
    for name, expected in store.manifest.files.items():
        try:
            path = stored_file(store.path, name)
        except StoreError as error:
            yield str(error)
            continue
        if path is None:
            yield f"{name}: missing"
        elif sha256_of(path) != expected:
            yield f"{name}: changed since it was written"
    for name in backend.leftovers():
        yield f"{name}: left over from an interrupted write"


def _check_identity(store: Store) -> Iterator[str]:
    try:
        same = parse_identity(store.file(IDENTITY).read_bytes(), store.address)
    except (OSError, StoreError):
        # Missing or changed, which its hash shows.
        return
    if same != store.manifest.sweep:
        yield f"{IDENTITY}: names another sweep than {MANIFEST}"


def _check_records(store: Store, backend: Backend) -> Iterator[str]:
    try:
        records = list(store.records())
    except (StoreError, ValidationError, KeyError, ValueError) as error:
        yield f"{TABLE}: a record does not fit its schema: {error}"
        return
    yield from _check_counts(store, store.table)
    kept = not store.manifest.traces_left_out
    traced = [(each, each.trace) for each in records if each.trace is not None and kept]
    files = backend.trace_files(trace.file for _, trace in traced)
    for (record, trace), path in zip(traced, files, strict=True):
        yield from _check_trace_of(path, record, trace)
    named = {trace.file for _, trace in traced}
    for name in backend.trace_names():
        if name not in named:
            yield f"{name}: belongs to no run"


def _check_columns(store: Store, backend: Backend) -> Iterator[str]:
    try:
        table = read_table(store.file(TABLE), [*OUTCOME_COLUMNS, "run_id", "trace_bytes"])
        version = store.columns.shared["schema_version"]
    except (StoreError, KeyError, ValueError) as error:
        yield f"{TABLE}: {error}"
        return
    if version != RECORD_VERSION:
        yield (
            f"{TABLE}: its records are of version {version}; "
            f"this contactlab reads version {RECORD_VERSION}"
        )
    yield from _check_counts(store, table)
    if not store.manifest.traces_left_out:
        yield from _check_trace_sizes(backend, table)


def _check_trace_sizes(backend: Backend, table: pa.Table) -> Iterator[str]:
    files, sizes = (table[name].drop_null().to_pylist() for name in ("trace_file", "trace_bytes"))
    for file, expected in zip(files, sizes, strict=True):
        size = backend.trace_size(file)
        if size is None:
            yield f"{file}: missing"
        elif size != expected:
            yield f"{file}: changed since it was written"


def _check_counts(store: Store, table: pa.Table) -> Iterator[str]:
    manifest = store.manifest
    for name, counted in count_outcomes(table).items():
        stated = getattr(manifest, name)
        if stated != counted:
            yield f"{MANIFEST}: {name} is {stated}, but {TABLE} has {counted}"
    if manifest.runs != manifest.sweep.runs_asked:
        planned = manifest.sweep.runs_asked
        yield f"{MANIFEST}: {manifest.runs} runs, but the sweep has {planned}"
    counts = table["run_id"].value_counts()
    repeated = np.flatnonzero(np.asarray(counts.field("counts")) > 1)
    for each in counts.take(pa.array(repeated)).to_pylist():
        yield f"{TABLE}: run {each['values']} occurs {each['counts']} times"


def _check_trace_of(path: Path | None, record: EvidenceRecord, trace: TraceFile) -> Iterator[str]:
    if path is None:
        yield f"{trace.file}: missing"
    elif sha256_of(path) != trace.sha256:
        yield f"{trace.file}: changed since it was written"
    else:
        yield from (f"{trace.file}: {problem}" for problem in check_trace(path))
        states = trace.messages.get("/state", 0)
        if states != record.steps + 1:
            yield f"{trace.file}: {states} states for {record.steps} steps"
