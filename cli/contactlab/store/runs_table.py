"""`runs.parquet`: one row per run, in plan order.

The table is written from the journal in groups of rows, with one group at a time in memory.
"""

import hashlib
import json
import os
import re
from collections import Counter, defaultdict
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.json
import pyarrow.parquet as pq
from numpy.typing import NDArray
from pydantic_core import from_json

from contactlab.errors import StoreError
from contactlab.store.arrow_values import number_array, numpy_array, zero_scalar
from contactlab.store.atomic_files import atomic_write
from contactlab.store.row_journal import SHARED, row_extent
from contactlab.store.store_files import TABLE, Address
from contactlab.store.table_layout import (
    COLUMNS_OF_MACHINE,
    Column,
    column_of,
    original_type,
    table_schema,
    texts_of,
)

OUTCOME_COLUMNS = ["label", "status", "trace_file", "expectation_met"]
_COLUMNS_KEY = b"contactlab.columns"
_SHARED_KEY = b"contactlab.shared"
GROUP = 1 << 14
"""Rows that are written at once, and read at once if some are needed: a row group or a part."""
NUMBERS = 1 << 17
"""Numbers of one column that are read at once, possibly from several row groups: 1 MiB."""
# Shared fields that depend on the machine, the day, and the name of the sweep.
_STORE_FIELDS = ("started", "finished", "provenance", "sweep")


@dataclass(frozen=True)
class TableLimits:
    """Limits that keep tables readable, and writing and reading them within some MiB.

    Attributes:
        most_groups: row groups of a table; opening it decodes the metadata of all their columns.
        block_bytes: of the journal that are parsed at once.
        buffer_bytes: of a table that are written at once; a column of few rows has 100 bytes.
        batch_rows: that are read at once from one of several tables.
        most_bytes: largest unpacked size of a table, plus `most_row_bytes` for each row.
        most_row_bytes: see `most_bytes`.
    """

    most_groups: int = 256
    block_bytes: int = 8 << 20
    buffer_bytes: int = 1 << 20
    batch_rows: int = 256
    most_bytes: int = 1 << 30
    most_row_bytes: int = 1 << 20


LIMITS = TableLimits()


class Digests(NamedTuple):
    """Digests of the rows of a table, independent of their encoding."""

    records: str  # digest of all columns
    # Digest of the computed results, without clocks, costs, times, machines and trace files. It is
    # the same for repeated computations on any machine.
    physics: str


def write_table(
    journal: Path, target: Path, own: Sequence[Column], shared: Mapping[str, Any]
) -> Digests:
    """Convert a journal, one row per line in any order, into the table. Return its digests.

    The table is replaced in one step. Besides the fixed columns it has its own ones, of axes,
    metrics, settings and effects. The fields that all runs share are in the file's metadata. Raises
    a StoreError if a row has another column, or a value of another type.
    """
    schema = table_schema(own)
    with journal.open("rb") as lines:
        return _write_groups(target, schema, shared, _journal_groups(journal, lines, schema))


def merge_tables(
    sources: Mapping[Address, Path], target: Path, shared: Mapping[str, Any]
) -> Digests:
    """Join the rows of tables, each in plan order, into one. Return the digests of its rows.

    A few rows of each are in memory at a time. Shared fields are those of the first table,
    overridden by `shared`. Raises a StoreError, which names the store, if a table has other
    columns.
    """
    first = next(iter(sources.values()))
    with table_errors(first):
        stored = pq.read_schema(first)
    schema = _original_schema(stored)
    for place, source in sources.items():
        with table_errors(place / TABLE):
            if _original_schema(pq.read_schema(source)) != schema:
                raise StoreError(
                    f"the tables of {place} and {next(iter(sources))} have different columns"
                )
    return _write_groups(
        target, schema, {**shared_fields(stored), **shared}, _merged_groups(sources)
    )


def _original_schema(stored: pa.Schema) -> pa.Schema:
    return table_schema([replace(column_of(f), type=original_type(f.type)) for f in stored])


def _write_groups(
    target: Path, schema: pa.Schema, shared: Mapping[str, Any], groups: Iterable[pa.Table]
) -> Digests:
    """Write row groups as a table. Return the digests of its rows."""
    described = {field.name: texts_of(field.metadata) for field in schema}
    meta = {
        _COLUMNS_KEY: json.dumps(described).encode(),
        _SHARED_KEY: json.dumps(dict(shared)).encode(),
    }
    digest = RowsDigest()
    strings, reals = (
        [field.name for field in schema if field.type == kind]
        for kind in (pa.string(), pa.float64())
    )
    with (
        atomic_write(target) as temporary,
        pa.output_stream(temporary, buffer_size=LIMITS.buffer_bytes) as sink,
        pq.ParquetWriter(
            sink,
            schema.with_metadata(meta),
            compression="zstd",
            compression_level=3,
            use_dictionary=strings,  # pyright: ignore[reportArgumentType]
            column_encoding=dict.fromkeys(reals, "BYTE_STREAM_SPLIT"),
        ) as writer,
    ):
        for group in groups:
            # Write it in one piece, because the ends of pieces would affect the ends of pages.
            table = pa.Table.from_arrays(group.combine_chunks().columns, schema=schema)
            table = table.replace_schema_metadata(meta)
            writer.write_table(table, row_group_size=len(table))
            for rows in table.to_batches():
                digest.add_rows(rows)
    return digest.digests_for(pq.read_schema(target))


def rows_of_group(runs: int) -> int:
    """Return the rows per row group in a table of `runs` rows; the last may have fewer."""
    size = GROUP
    while runs > LIMITS.most_groups * size:
        size *= 2
    return size


def _journal_groups(journal: Path, lines: BinaryIO, schema: pa.Schema) -> Iterator[pa.Table]:
    """Yield the rows of a journal in plan order, a row group at a time."""
    reader = _RowReader(lines, schema)
    spans = np.fromiter(_line_spans(lines), _LINE_SPAN)
    spans = spans[np.argsort(spans["index"], kind="stable")]
    size = rows_of_group(len(spans))
    for first in range(0, len(spans), size):
        try:
            yield reader.read_spans(spans[first : first + size])
        except pa.ArrowException as error:
            raise StoreError(
                f"{journal}: a row is incompatible with the table: {error}; add --repair to run "
                "it again"
            ) from error


def _merged_groups(sources: Mapping[Address, Path]) -> Iterator[pa.Table]:
    """Yield the rows of several tables in plan order, a row group at a time."""
    places = [_plan_indices(path) for path in sources.values()]
    order = np.argsort(np.concatenate(places), kind="stable")
    of_source = np.repeat(np.arange(len(places)), [len(part) for part in places])[order]
    group, size = rows_of_group(len(order)), max(LIMITS.batch_rows, GROUP // len(places))
    with ExitStack() as opened:
        readers = [
            _RowSource(opened.enter_context(pq.ParquetFile(path)), size)
            for path in sources.values()
        ]
        for first in range(0, len(of_source), group):
            source_order = of_source[first : first + group]
            counts = np.bincount(source_order, minlength=len(readers)).tolist()
            rows = pa.concat_tables(
                [
                    reader.take_rows(count)
                    for reader, count in zip(readers, counts, strict=True)
                    if count
                ]
            )
            # Row j of these, source by source, belongs to index p[j] of the group.
            back = np.empty(len(source_order), np.int64)
            back[np.argsort(source_order, kind="stable")] = np.arange(len(source_order))
            yield compute_digests("take", rows, number_array(back))


def _plan_indices(table: Path) -> NDArray[np.int64]:
    with table_errors(table):
        return numpy_array(pq.read_table(table, columns=["index"], use_threads=False)["index"])


class _RowSource:
    """Provides the rows of a table one after the other."""

    def __init__(self, file: pq.ParquetFile, size: int) -> None:
        self._batches = batches_of(file, size)
        self._left = file.schema_arrow.empty_table()

    def take_rows(self, count: int) -> pa.Table:
        """Return the next rows."""
        while len(self._left) < count:
            batch = pa.Table.from_batches([next(self._batches)])
            self._left = pa.concat_tables([self._left, batch])
        first_rows, self._left = self._left.slice(0, count), self._left.slice(count)
        return first_rows


class _RowReader:
    """Reads rows of a journal as parts of its table."""

    def __init__(self, lines: BinaryIO, schema: pa.Schema) -> None:
        self._lines, self._schema = lines, schema
        self._found = dict[str, None]()  # own fields of the rows so far

    def read_spans(self, spans: NDArray[np.void]) -> pa.Table:
        """Return rows, including their shared fields."""
        own = pa.concat_tables(
            [self._all_rows(block) for block in _line_blocks(self._lines, spans)]
        )
        if (spans["shared"] == spans["start"]).all():
            return own
        _, firsts, places = np.unique(spans["shared"], return_index=True, return_inverse=True)
        shared = spans[firsts]
        shared["start"], shared["size"] = shared["shared"], shared["shared_size"]
        blocks = _line_blocks(self._lines, shared)
        shared_rows = pa.concat_tables([_parse_rows(block, self._schema) for block in blocks])
        pairs = zip(own.columns, shared_rows.columns, strict=True)
        columns = [_fill_nulls(*pair, number_array(places)) for pair in pairs]
        return pa.table(columns, schema=self._schema)

    def _all_rows(self, block: bytes) -> pa.Table:
        """Return the own fields of rows, with nulls for missing ones."""
        try:
            # The parser takes time for every possible field.
            rows = _parse_rows(block, pa.schema([self._schema.field(name) for name in self._found]))
        except pa.ArrowInvalid:
            rows = _parse_rows(block, self._schema)
            columns = zip(rows.column_names, rows.columns, strict=True)
            self._found |= {
                name: None for name, column in columns if column.null_count < len(column)
            }
            return rows
        absent = ((field.name, pa.nulls(len(rows), field.type)) for field in self._schema)
        stored_columns = dict(zip(rows.column_names, rows.columns, strict=True))
        return pa.table({**dict(absent), **stored_columns}, schema=self._schema)


def _fill_nulls(own: pa.ChunkedArray, shared: pa.ChunkedArray, places: pa.Array) -> pa.ChunkedArray:
    """Return a column of rows, with nulls replaced by the shared values at these indices."""
    if shared.null_count == len(shared):
        return own
    shared_values = compute_digests("take", shared, places)
    return (
        shared_values
        if own.null_count == len(own)
        else compute_digests("coalesce", own, shared_values)
    )


def _parse_rows(lines: bytes, schema: pa.Schema) -> pa.Table:
    table = pyarrow.json.read_json(
        pa.BufferReader(lines),
        read_options=pyarrow.json.ReadOptions(use_threads=False, block_size=len(lines)),
        parse_options=pyarrow.json.ParseOptions(
            explicit_schema=schema, unexpected_field_behavior="error"
        ),
    )
    return pa.Table.from_arrays(table.select(schema.names).columns, schema=schema)


_LINE_SPAN = np.dtype(
    [(name, np.int64) for name in ("index", "start", "size", "shared", "shared_size")]
)
# The start of every row, so that the row need not be parsed completely.
_LINE_START = re.compile(rb'\{"run_id": ?"\w*", ?"index": ?(\d+),')


def _line_spans(lines: BinaryIO) -> Iterator[tuple[int, int, int, int, int]]:
    """Yield index, start and size of each row, and those of its shared fields, or its own."""
    start, shared = 0, (0, 0)
    for line in lines:
        size, name = row_extent(line)
        if name == SHARED:
            shared = start, size
        else:
            head = _LINE_START.match(line)
            index = int(head[1]) if head else int(from_json(line[:size])["index"])
            yield index, start, size, *(shared if name else (start, size))
        start += len(line)


def _line_blocks(lines: BinaryIO, spans: NDArray[np.void]) -> Iterator[bytes]:
    """Yield rows of a journal as blocks of whole lines of some MiB."""
    block = (np.cumsum(spans["size"]) - spans["size"]) // LIMITS.block_bytes
    for part in np.split(spans, np.flatnonzero(np.diff(block)) + 1):
        where = zip(part["start"].tolist(), part["size"].tolist(), strict=True)
        yield b"\n".join([*(os.pread(lines.fileno(), size, start) for start, size in where), b""])


def write_compact_table(table: pa.Table, target: Path) -> None:
    """Write a table without descriptions and column statistics, which are informative only."""
    fields = [field.with_metadata(_essential_metadata(field)) for field in table.schema]
    meta = {_SHARED_KEY: (table.schema.metadata or {})[_SHARED_KEY]}
    essential = pa.Table.from_arrays(table.columns, schema=pa.schema(fields, meta))
    with pa.output_stream(target, buffer_size=LIMITS.buffer_bytes) as sink:
        pq.write_table(
            essential,
            sink,
            compression="zstd",
            compression_level=19,
            write_statistics=False,
            use_dictionary=False,
        )


def _essential_metadata(field: pa.Field) -> dict[bytes, bytes]:
    """Return the metadata of a column without its description, which is informative only."""
    return {key: text for key, text in (field.metadata or {}).items() if key != b"description"}


def check_table_size(path: Path, runs: int) -> None:
    """Check the number of rows and the size of a table before any of it is unpacked.

    A missing or damaged table is left to its readers.
    """
    try:
        meta = pq.read_metadata(path)
    except (pa.ArrowException, OSError):
        return
    if meta.num_rows > runs:
        raise StoreError(f"{path} is damaged: it has {meta.num_rows:,} rows for {runs:,} runs")
    if meta.num_row_groups > 2 * LIMITS.most_groups:
        groups = f"{meta.num_row_groups:,} row groups"
        raise StoreError(f"{path} is damaged: it has {groups} for {runs:,} runs")
    size = sum(meta.row_group(group).total_byte_size for group in range(meta.num_row_groups))
    if size > LIMITS.most_bytes + runs * LIMITS.most_row_bytes:
        raise StoreError(f"{path} is damaged: its header declares {size:,} bytes")


def iterate_rows(path: Path, chosen: NDArray[np.bool_] | None = None) -> Iterator[dict[str, Any]]:
    """Yield every row of a table, or the `chosen` ones (runs,), by batches; see `table_errors`."""
    with table_errors(path), pq.ParquetFile(path) as file:
        sizes = [file.metadata.row_group(group).num_rows for group in range(file.num_row_groups)]
        for group, stop in enumerate(np.cumsum(np.array(sizes, np.int64)).tolist()):
            start = stop - sizes[group]
            if chosen is not None and not chosen[start:stop].any():
                continue
            for batch in batches_of(file, LIMITS.batch_rows, groups=[group]):
                if chosen is None:
                    yield from batch.to_pylist()
                elif (places := np.flatnonzero(chosen[start : start + len(batch)])).size:
                    yield from batch.take(number_array(places)).to_pylist()
                start += len(batch)


def batches_of(
    file: pq.ParquetFile,
    size: int,
    names: Sequence[str] | None = None,
    groups: Iterable[int] | None = None,
) -> Iterator[pa.RecordBatch]:
    """Yield the rows of a table, or of some groups or columns, at most `size` at a time.

    As many row groups are read at once as fit; a reader across more of them would keep all texts
    that it has read.
    """
    # Row groups in lots of at most `size` rows, or of a single group.
    lots, rows = list[list[int]](), 0
    for group in range(file.num_row_groups) if groups is None else groups:
        own = file.metadata.row_group(group).num_rows
        if not lots or rows + own > size:
            lots.append([])
            rows = 0
        lots[-1].append(group)
        rows += own
    for lot in lots:
        if len(lot) > 1 or file.metadata.row_group(lot[0]).num_rows <= size:
            yield from file.read_row_groups(lot, names, use_threads=False).to_batches()
        else:
            yield from file.iter_batches(size, row_groups=lot, columns=names, use_threads=False)


@contextmanager
def table_errors(path: object) -> Generator[None]:
    """Convert errors of reading a table into a StoreError."""
    try:
        yield
    except FileNotFoundError as error:
        raise StoreError(f"{path} is missing; the sweep has not finished, run it again") from error
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        raise StoreError(f"{path} is damaged: {error}") from error


def count_outcomes(parts: Iterable[pa.RecordBatch]) -> dict[str, Any]:
    """Return the manifest's counts, from the rows of a table, which have OUTCOME_COLUMNS."""
    names = {True: "met", False: "unmet", None: "none"}
    runs = traces = 0
    labels, statuses, expectations = Counter[str](), Counter[str](), Counter[bool | None]()
    for rows in parts:
        runs += len(rows)
        traces += len(rows) - rows["trace_file"].null_count
        counters = {"label": labels, "status": statuses, "expectation_met": expectations}
        for name, counter in counters.items():
            value_counts = rows[name].value_counts()
            counter.update({each["values"]: each["counts"] for each in value_counts.to_pylist()})
    return {
        "runs": runs,
        "labels": dict(labels),
        "statuses": dict(statuses),
        "traces": traces,
        "expectations": {names[value]: count for value, count in expectations.items()},
    }


def shared_fields(schema: pa.Schema) -> dict[str, Any]:
    """Return the fields that all runs of a table share, from the metadata of its schema."""
    return json.loads((schema.metadata or {})[_SHARED_KEY])


def listed_columns(schema: pa.Schema) -> dict[str, Any]:
    """Return the description of columns in the metadata of a table; empty for a compact one."""
    return json.loads((schema.metadata or {}).get(_COLUMNS_KEY, b"{}"))


def compute_digests(
    function: str, *arrays: object, options: pc.FunctionOptions | None = None
) -> Any:  # noqa: ANN401
    """Return the result of an Arrow function by name; the methods would load all wrappers."""
    return pc.call_function(function, [*arrays], options)


def digests_of(path: Path) -> Digests:
    """Return the digests of the rows of a stored table; see `RowsDigest`."""
    with table_errors(path), pq.ParquetFile(path) as file:
        digest = RowsDigest()
        for batch in batches_of(file, GROUP):
            digest.add_rows(batch)
        return digest.digests_for(file.schema_arrow)


class RowsDigest:
    """A digest of rows, independent of their encoding, compression and row groups.

    Each column is one or more streams of bytes: the validity of values, the lengths of texts and
    lists, and the values themselves, with nulls as zeros. The digest is the SHA-256 of the names,
    types and units of all columns, the SHA-256 of each of their streams, and the fields that all
    runs share. A copy with another compression has the same digest; another value, order or column
    changes it.
    """

    def __init__(self) -> None:
        self._streams = defaultdict[tuple[str, str], _StreamDigest](_StreamDigest)

    def add_rows(self, rows: pa.RecordBatch) -> pa.RecordBatch:
        """Add the rows that follow, and return them."""
        for name, column in zip(rows.schema.names, rows.columns, strict=True):
            self._add_column(name, name, column)
        return rows

    def _add_column(self, name: str, part: str, column: pa.Array) -> None:
        """Add the next rows to the streams of a column, or of a part of it."""
        kind, validity = column.type, self._streams[name, f"{part}?"]
        if column.null_count in {0, len(column)}:
            validity.add_repeated(b"\0" if column.null_count else b"\1", len(column))
        else:
            validity.add_values(numpy_array(compute_digests("is_valid", column)))
        if pa.types.is_struct(kind):
            for field, inner in zip(kind, column.flatten(), strict=True):
                self._add_column(name, f"{part}.{field.name}", inner)
        elif pa.types.is_list(kind):
            self._streams[name, f"{part}#"].add_values(_entry_lengths("list_value_length", column))
            self._add_column(name, f"{part}[]", compute_digests("list_flatten", column))
        elif pa.types.is_string(kind):
            self._streams[name, f"{part}#"].add_values(_entry_lengths("binary_length", column))
            self._streams[name, f"{part}="].add_values(
                _join_letters(compute_digests("drop_null", column))
            )
        else:
            self._streams[name, f"{part}="].add_values(_filled_numbers(column))

    def digests_for(self, schema: pa.Schema) -> Digests:
        """Return the digests of all rows that were added, with the schema of the stored table."""
        shared = shared_fields(schema)
        physics = [field for field in schema if field.name not in COLUMNS_OF_MACHINE]
        own = {name: value for name, value in shared.items() if name not in _STORE_FIELDS}
        return Digests(self._hex_digest(list(schema), shared), self._hex_digest(physics, own))

    def _hex_digest(self, fields: Sequence[pa.Field], shared: Mapping[str, Any]) -> str:
        described = [
            [field.name, str(field.type), texts_of(_essential_metadata(field))] for field in fields
        ]
        names = {field.name for field in fields}
        digests = {
            stream: digest.hexdigest()
            for (column, stream), digest in self._streams.items()
            if column in names
        }
        head = json.dumps([described, shared], sort_keys=True)
        return hashlib.sha256((head + json.dumps(digests, sort_keys=True)).encode()).hexdigest()


class _StreamDigest:
    """The SHA-256 of a stream, hashed only once its items stop being equal.

    Most columns have the same value for all runs, or none: for columns that repeat the same item
    equally often, the bytes are hashed once.
    """

    def __init__(self) -> None:
        self._item, self._times = b"", 0
        self._digest: Any = None

    def add_values(self, values: NDArray[Any]) -> None:
        """Add the bytes of values (n,)."""
        data, width = values.view(np.uint8), values.itemsize
        alike = len(data) > width and data[:width].tobytes() == data[-width:].tobytes()
        if alike and np.array_equal(data[width:], data[:-width]):
            self.add_repeated(data[:width].tobytes(), len(values))
        elif len(data):
            self._new_hasher().update(data)

    def add_repeated(self, item: bytes, times: int) -> None:
        """Add an item `times` times."""
        if self._digest is None and self._item in {b"", item}:
            self._item = item if times else self._item
            self._times += times
        else:
            self._new_hasher().update(item * times)

    def hexdigest(self) -> str:
        """Return the digest of the added values."""
        return (self._digest or _repetition_hash(self._item, self._times)).hexdigest()

    def _new_hasher(self) -> Any:  # noqa: ANN401 - hashlib has no name for it
        if self._digest is None:
            self._digest = _repetition_hash(self._item, self._times).copy()
        return self._digest


# Cached hashes of repeated items.
@lru_cache(64)
def _repetition_hash(item: bytes, times: int) -> Any:  # noqa: ANN401 - hashlib has no name for it
    """Return the SHA-256 of a repeated item; copy it before updating it."""
    # Bytes that are hashed at once.
    digest, at_once = hashlib.sha256(), max(1, (1 << 20) // max(1, len(item)))
    block, (blocks, rest) = item * at_once, divmod(times, at_once)
    for _ in range(blocks):
        digest.update(block)
    digest.update(item * rest)
    return digest


def _join_letters(texts: pa.Array) -> NDArray[Any]:
    """Return the letters of texts, with one value per text if all have the same length."""
    _, places, letters = texts.buffers()
    if not len(texts) or letters is None:
        return np.empty(0, np.uint8)
    ends = np.frombuffer(places, np.int32)[texts.offset :][[0, len(texts)]]
    joined = np.frombuffer(letters, np.uint8)[slice(*ends.tolist())]
    width, rest = divmod(len(joined), len(texts))
    return joined if rest or not width else joined.view(f"V{width}")


def _entry_lengths(function: str, column: pa.Array) -> NDArray[np.int64]:
    """Return (n,) lengths of texts or lists by a function of Arrow, 0 for nulls."""
    if column.null_count == len(column):
        return np.zeros(len(column), np.int64)
    return _filled_numbers(compute_digests(function, column)).astype(np.int64)


def _filled_numbers(column: pa.Array) -> NDArray[Any]:
    """Return (n,) numbers or booleans, 0 for nulls."""
    if 0 < column.null_count < len(column):
        column = compute_digests("coalesce", column, zero_scalar(column.type))
    values = numpy_array(column)
    return np.zeros_like(values) if column.null_count else values
