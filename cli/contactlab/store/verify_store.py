"""Check a store: every file against its hash, every record against its schema, every trace."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
from pydantic import ValidationError

from contactlab.errors import StoreError
from contactlab.schema import RECORD_VERSION, EvidenceRecord, TraceFile
from contactlab.store.atomic_files import sha256_of
from contactlab.store.finished_store import Store
from contactlab.store.holdings import Holdings, holdings
from contactlab.store.mcap import check_trace
from contactlab.store.runs_table import OUTCOME_COLUMNS, TABLE, count_outcomes, read_table
from contactlab.store.store_address import Address
from contactlab.store.store_manifest import IDENTITY, MANIFEST, read_identity


def verify(address: Address, *, thorough: bool = True) -> list[str]:
    """Return what is wrong with a store, in words; nothing if it is sound.

    Args:
        address: the store's folder, or where it lies in object storage.
        thorough: whether to check every record against its schema and every trace's bytes; if
            not, traces must be there with their size.

    Raises:
        StoreError: it cannot be opened at all.
    """
    store = Store.open(address)
    held = holdings(address)
    check = _records if thorough else _outline
    return [*_files(store, held), *_identity(store), *check(store, held)]


def _files(store: Store, held: Holdings) -> Iterator[str]:
    for name, expected in store.manifest.files.items():
        path = store.path / name
        if not path.is_file():
            yield f"{name}: missing"
        elif sha256_of(path) != expected:
            yield f"{name}: changed since it was written"
    for name in held.leftovers():
        yield f"{name}: left over from an interrupted write"


def _identity(store: Store) -> Iterator[str]:
    try:
        same = read_identity(store.path) == store.manifest.sweep
    except StoreError:
        # Missing or changed, which its hash tells.
        return
    if not same:
        yield f"{IDENTITY}: names another sweep than {MANIFEST}"


def _records(store: Store, held: Holdings) -> Iterator[str]:
    try:
        records = list(store.records())
    except (StoreError, ValidationError, KeyError, ValueError) as error:
        yield f"runs.parquet: a record does not fit its schema: {error}"
        return
    yield from _counts(store, store.table)
    kept = not store.manifest.traces_left_out
    traced = [(each, each.trace) for each in records if each.trace is not None and kept]
    files = held.files(trace.file for _, trace in traced)
    for (record, trace), path in zip(traced, files, strict=True):
        yield from _trace(path, record, trace)
    named = {trace.file for _, trace in traced}
    for name in held.traces():
        if name not in named:
            yield f"{name}: belongs to no run"


def _outline(store: Store, held: Holdings) -> Iterator[str]:
    try:
        table = read_table(store.path / TABLE, [*OUTCOME_COLUMNS, "run_id", "trace_bytes"])
        version = store.columns.shared["schema_version"]
    except (StoreError, KeyError, ValueError) as error:
        yield f"{TABLE}: {error}"
        return
    if version != RECORD_VERSION:
        yield (
            f"{TABLE}: its records are of version {version}; "
            f"this contactlab reads version {RECORD_VERSION}"
        )
    yield from _counts(store, table)
    if not store.manifest.traces_left_out:
        yield from _sizes(held, table)


def _sizes(held: Holdings, table: pa.Table) -> Iterator[str]:
    files, sizes = (table[name].drop_null().to_pylist() for name in ("trace_file", "trace_bytes"))
    for file, size in zip(files, sizes, strict=True):
        found = held.size(file)
        if found is None:
            yield f"{file}: missing"
        elif found != size:
            yield f"{file}: changed since it was written"


def _counts(store: Store, table: pa.Table) -> Iterator[str]:
    manifest = store.manifest
    for name, found in count_outcomes(table).items():
        said = getattr(manifest, name)
        if said != found:
            yield f"manifest.json: {name} is {said}, but runs.parquet has {found}"
    if manifest.runs != manifest.sweep.runs_asked:
        yield f"manifest.json: {manifest.runs} runs, but {manifest.sweep.runs_asked} were asked for"
    counted = table["run_id"].value_counts()
    repeated = np.flatnonzero(np.asarray(counted.field("counts")) > 1)
    for each in counted.take(pa.array(repeated)).to_pylist():
        yield f"runs.parquet: run {each['values']} stands {each['counts']} times"


def _trace(path: Path | None, record: EvidenceRecord, trace: TraceFile) -> Iterator[str]:
    if path is None:
        yield f"{trace.file}: missing"
    elif sha256_of(path) != trace.sha256:
        yield f"{trace.file}: changed since it was written"
    else:
        yield from (f"{trace.file}: {problem}" for problem in check_trace(path))
        states = trace.messages.get("/state", 0)
        if states != record.steps + 1:
            yield f"{trace.file}: {states} states for {record.steps} steps"
