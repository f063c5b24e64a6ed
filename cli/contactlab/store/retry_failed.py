"""Runs that failed are taken out of a store, so that its sweep runs them again.

A store that is interrupted while this goes on is finished as before, or unfinished and resumable.
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from contactlab.errors import StoreError
from contactlab.schema import StoreManifest
from contactlab.store.atomic_files import atomic_write, sync_filesystem
from contactlab.store.row_journal import JOURNAL, read_lines, rewrite_lines
from contactlab.store.runs_table import TABLE, read_table, table_errors
from contactlab.store.store_manifest import MANIFEST

FAILED = frozenset({"crashed", "error", "timeout"})
_AT_ONCE = 1024


def reopen(store: Path, manifest: StoreManifest) -> bool:
    """Make a finished store that holds failed runs an unfinished one, with all of its runs.

    Args:
        store: its folder.
        manifest: its manifest.

    Returns:
        Whether it holds any; if not, it stays as it is.

    Raises:
        StoreError: its table is damaged, or its traces were left out.
        OutputError: the journal cannot be written.
    """
    statuses = read_table(store / TABLE, ["status"])["status"].unique().to_pylist()
    if FAILED.isdisjoint(statuses):
        return False
    if manifest.traces_left_out:
        raise StoreError(f"{store} is a baseline without traces; sweep again elsewhere with -o")
    with atomic_write(store / JOURNAL, durable=True) as temporary, temporary.open("wb") as journal:
        journal.writelines(journal_lines(store / TABLE))
    (store / MANIFEST).unlink()
    sync_filesystem(store)
    return True


def journal_lines(table: Path) -> Iterator[bytes]:
    """Yield every row of a table as the line of a journal that it came from.

    Raises:
        StoreError: the table is damaged.
    """
    with table_errors(table), pq.ParquetFile(table) as file:
        for batch in file.iter_batches(_AT_ONCE):
            yield from (json.dumps(row).encode() + b"\n" for row in batch.to_pylist())


def failed_traces(store: Path) -> list[str]:
    """Return the names of the traces of failed runs in an unfinished store."""
    rows = (row for row in read_lines(store / JOURNAL) if _has_failed(row))
    return [row["trace_file"] for row in rows if row["trace_file"]]


def drop_failed(store: Path) -> None:
    """Take failed runs out of an unfinished store: their traces first, then their lines.

    Raises:
        OutputError: the journal cannot be written anew.
    """
    path = store / JOURNAL
    failed = {row["run_id"]: row["trace_file"] for row in read_lines(path) if _has_failed(row)}
    if not failed:
        return
    for trace in filter(None, failed.values()):
        (store / trace).unlink(missing_ok=True)
    rewrite_lines(path, (row for row in read_lines(path) if row["run_id"] not in failed))


def _has_failed(row: Mapping[str, Any]) -> bool:
    return row["status"] in FAILED
