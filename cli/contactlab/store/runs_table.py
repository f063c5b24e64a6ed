"""`runs.parquet`: one row a run, in plan order."""

import json
import os
import re
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.json
import pyarrow.parquet as pq
from numpy.typing import NDArray
from pydantic_core import from_json

from contactlab.errors import StoreError
from contactlab.store.atomic_files import atomic_write
from contactlab.store.table_layout import Column, table_schema

TABLE = "runs.parquet"
_COLUMNS = b"contactlab.columns"
_SHARED = b"contactlab.shared"
_GROUP = 1 << 14
"""Runs that are written at once, and read at once where one is asked for."""
OUTCOME_COLUMNS = ["label", "status", "trace_file", "expectation_met"]


def write_table(
    journal: Path, target: Path, own: Sequence[Column], shared: Mapping[str, Any]
) -> None:
    """Turn a journal into the table, one group of rows after the other.

    Args:
        journal: one row a line, as JSON, in any order.
        target: the Parquet file, replaced in one step.
        own: columns of axes, metrics, settings and effects.
        shared: what all runs have in common, kept in the file's metadata.
    """
    schema, rows = table_schema(own), OrderedLines(journal)
    described = {
        field.name: {key.decode(): text.decode() for key, text in (field.metadata or {}).items()}
        for field in schema
    }
    meta = {_COLUMNS: json.dumps(described).encode(), _SHARED: json.dumps(dict(shared)).encode()}
    with (
        atomic_write(target) as temporary,
        pq.ParquetWriter(
            temporary,
            schema.with_metadata(meta),
            compression="zstd",
            compression_level=3,
            use_dictionary=_texts(schema),  # pyright: ignore[reportArgumentType]
            column_encoding=dict.fromkeys(_reals(schema), "BYTE_STREAM_SPLIT"),
        ) as writer,
    ):
        for first in range(0, len(rows), _GROUP):
            parts = [_parsed(block, schema) for block in rows.blocks(first, first + _GROUP)]
            table = pa.concat_tables(parts).replace_schema_metadata(meta)
            writer.write_table(table, row_group_size=_GROUP)


def _parsed(lines: bytes, schema: pa.Schema) -> pa.Table:
    table = pyarrow.json.read_json(
        pa.BufferReader(lines),
        read_options=pyarrow.json.ReadOptions(use_threads=False, block_size=len(lines)),
        parse_options=pyarrow.json.ParseOptions(
            explicit_schema=schema, unexpected_field_behavior="error"
        ),
    )
    return table.select(schema.names).cast(schema)


def write_compact_table(source: Path, target: Path) -> None:
    """Write a table anew without what only explains: descriptions, and statistics of columns."""
    table = read_table(source)
    fields = [field.with_metadata(_essential(field)) for field in table.schema]
    meta = {_SHARED: (table.schema.metadata or {})[_SHARED]}
    pq.write_table(
        pa.Table.from_arrays(table.columns, schema=pa.schema(fields, meta)),
        target,
        compression="zstd",
        compression_level=19,
        write_statistics=False,
        use_dictionary=False,
    )


def _essential(field: pa.Field) -> dict[bytes, bytes]:
    return {key: text for key, text in (field.metadata or {}).items() if key != b"description"}


def read_table(path: Path, columns: list[str] | None = None, *, named: object = None) -> pa.Table:
    """Return the table, or some of its columns.

    Args:
        path: its file.
        columns: which of them; all if left out.
        named: what messages call it, if it is not that file.

    Raises:
        StoreError: there is none, or it is damaged.
    """
    with table_errors(named or path):
        return pq.read_table(path, columns=columns)


@contextmanager
def table_errors(path: object) -> Generator[None]:
    """Turn what goes wrong with reading a table into a StoreError."""
    try:
        yield
    except FileNotFoundError as error:
        raise StoreError(f"{path} is missing; the sweep has not finished, run it again") from error
    except (pa.ArrowException, OSError) as error:
        raise StoreError(f"{path} is damaged: {error}") from error


def count_outcomes(table: pa.Table) -> dict[str, Any]:
    """Return how many runs a table holds, of which label and so on, as the manifest has it.

    Args:
        table: the columns of `TALLIED`, or more.
    """
    outcome = {True: "met", False: "unmet", None: "none"}
    expectations = _counts(table["expectation_met"])
    return {
        "runs": table.num_rows,
        "labels": _counts(table["label"]),
        "statuses": _counts(table["status"]),
        "traces": table.num_rows - table["trace_file"].null_count,
        "expectations": {outcome[met]: count for met, count in expectations.items()},
    }


def _counts(column: pa.ChunkedArray) -> dict[Any, int]:
    return {each["values"]: each["counts"] for each in column.value_counts().to_pylist()}


def shared_fields(schema: pa.Schema) -> dict[str, Any]:
    """Return what all runs of the table with this schema have in common."""
    return json.loads((schema.metadata or {})[_SHARED])


def _texts(schema: pa.Schema) -> list[str]:
    return [field.name for field in schema if pa.types.is_string(field.type)]


def _reals(schema: pa.Schema) -> list[str]:
    return [field.name for field in schema if pa.types.is_float64(field.type)]


# How every row begins, so that it need not be read to its end.
_HEAD = re.compile(rb'\{"run_id": ?"\w*", ?"index": ?(\d+),')
_BLOCK = 8 << 20


class OrderedLines:
    """A journal's rows by their place in the plan; of each, only that and where it lies is held.

    Args:
        journal: one row a line, as JSON, in any order, none of them torn.
    """

    def __init__(self, journal: Path) -> None:
        self._path = journal
        with journal.open("rb") as lines:
            found = np.fromiter(_spans(lines), _SPAN)
        self._spans = found[np.argsort(found["index"], kind="stable")]

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self._spans)

    def blocks(self, first: int, stop: int) -> Iterator[bytes]:
        """Yield some rows, in order, as blocks of whole lines of some MiB."""
        spans = self._spans[first:stop]
        # A row goes to the block in which its first byte would be, were they all of one length.
        block = (np.cumsum(spans["size"]) - spans["size"]) // _BLOCK
        with self._path.open("rb") as file:
            for part in np.split(spans, np.flatnonzero(np.diff(block)) + 1):
                yield _read(file, part)


_SPAN = np.dtype([("index", np.int64), ("start", np.int64), ("size", np.int64)])


def _spans(lines: BinaryIO) -> Iterator[tuple[int, int, int]]:
    start = 0
    for line in lines:
        yield _index(line), start, len(line)
        start += len(line)


def _index(line: bytes) -> int:
    head = _HEAD.match(line)
    return int(head[1]) if head else int(from_json(line)["index"])


def _read(file: BinaryIO, spans: NDArray[np.void]) -> bytes:
    where = zip(spans["start"].tolist(), spans["size"].tolist(), strict=True)
    return b"".join([os.pread(file.fileno(), size, start) for start, size in where])
