"""`runs.parquet`: one row a run, in plan order."""

import json
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.json
import pyarrow.parquet as pq

from contactlab.errors import StoreError
from contactlab.store.columns import Column, table_schema
from contactlab.store.files import replacing
from contactlab.store.ordering import OrderedLines

TABLE = "runs.parquet"
_COLUMNS = b"contactlab.columns"
_SHARED = b"contactlab.shared"
_GROUP = 1 << 14
"""Runs that are written at once, and read at once where one is asked for."""
TALLIED = ["label", "status", "trace_file", "expectation_met"]


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
        replacing(target) as temporary,
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


def write_compact(source: Path, target: Path) -> None:
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
    with reading(named or path):
        return pq.read_table(path, columns=columns)


@contextmanager
def reading(path: object) -> Generator[None]:
    """Turn what goes wrong with reading a table into a StoreError."""
    try:
        yield
    except FileNotFoundError as error:
        raise StoreError(f"{path} is missing; the sweep has not finished, run it again") from error
    except (pa.ArrowException, OSError) as error:
        raise StoreError(f"{path} is damaged: {error}") from error


def tally(table: pa.Table) -> dict[str, Any]:
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


def shared_of(schema: pa.Schema) -> dict[str, Any]:
    """Return what all runs of the table with this schema have in common."""
    return json.loads((schema.metadata or {})[_SHARED])


def _texts(schema: pa.Schema) -> list[str]:
    return [field.name for field in schema if pa.types.is_string(field.type)]


def _reals(schema: pa.Schema) -> list[str]:
    return [field.name for field in schema if pa.types.is_float64(field.type)]
