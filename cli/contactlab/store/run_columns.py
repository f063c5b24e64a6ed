"""The table's columns as NumPy arrays, each read on demand."""

import hashlib
import math
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property, lru_cache
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from contactlab.errors import StoreError
from contactlab.store.arrow_values import number_array, numpy_array, text_scalar
from contactlab.store.runs_table import (
    GROUP,
    NUMBERS,
    batches_of,
    compute_digests,
    iterate_rows,
    listed_columns,
    shared_fields,
    table_errors,
)
from contactlab.store.store_files import TABLE, Address, stored_file
from contactlab.store.table_layout import Column, check_layout, column_of


class NumberColumn(NamedTuple):
    """A column of numbers."""

    values: NDArray[np.float64]  # (n,) NaN for nulls
    valid: NDArray[np.bool_]  # (n,) whether a value exists; a valid value may be NaN, too

    def at(self, rows: NDArray[np.integer[Any]] | slice) -> "NumberColumn":
        """Return the numbers of some rows."""
        return NumberColumn(self.values[rows], self.valid[rows])


class CodedColumn(NamedTuple):
    """A column with each of its distinct values once."""

    codes: NDArray[np.integer]  # (n,) index of a run's value in `values`
    values: tuple[Any, ...]  # the distinct values, with None last if runs lack a value


class RunColumns:
    """The table in the folder of a store, read column by column on demand.

    Several threads may read at once. A StoreError, which names the store's address, says that the
    table does not exist or is damaged, or that it lacks a requested column.
    """

    def __init__(self, store: Path, address: Address | None = None) -> None:
        self.path = (address or store) / TABLE
        with table_errors(self.path):
            self._source = stored_file(store, TABLE) or store / TABLE
            file = pq.ParquetFile(self._source)
        self._metadata, self._files = file.metadata, threading.local()
        self._files.own = file
        try:
            check_layout(file.schema_arrow, shared_fields(file.schema_arrow))
        except (ValueError, TypeError, LookupError, RecursionError) as error:
            reason = error if isinstance(error, ValueError | TypeError) else type(error).__name__
            raise StoreError(f"{self.path} is damaged: {reason}") from error
        # Cached parts of rows, for requests of neighboring rows.
        self._part_of = lru_cache(4)(self._read_part)

    @property
    def _file(self) -> pq.ParquetFile:
        # Two threads that read one of these get each other's bytes, or an error.
        if not hasattr(self._files, "own"):
            self._files.own = pq.ParquetFile(self._source, metadata=self._metadata)
        return self._files.own

    @property
    def runs(self) -> int:
        """The number of runs."""
        return self._metadata.num_rows

    @cached_property
    def schema(self) -> pa.Schema:
        """The columns' types and metadata."""
        return self._file.schema_arrow

    @cached_property
    def shared(self) -> Mapping[str, Any]:
        """The fields that all runs share."""
        return shared_fields(self.schema)

    @cached_property
    def column_descriptions(self) -> Mapping[str, Any]:
        """The file's description of columns for readers without Arrow; empty if it has none."""
        return listed_columns(self.schema)

    @cached_property
    def described(self) -> Mapping[str, Column]:
        """All columns by name, in table order."""
        return {column.name: column for column in map(column_of, self.schema)}

    @cached_property
    def metric_columns(self) -> Mapping[str, Column]:
        """The columns of measured values by name, in table order."""
        return {name: column for name, column in self.described.items() if column.better}

    def read_arrow(self, names: Sequence[str] | None = None) -> pa.Table:
        """Return the table, or some of its columns."""
        with table_errors(self.path):
            table = self._file.read(names and list(names), use_threads=False)
            # Text that is not UTF-8 is damage, too.
            table.validate(full=True)
            return table

    def iterate_batches(self, names: Sequence[str] | None = None) -> Iterator[pa.RecordBatch]:
        """Yield some thousand rows at a time, with all or some columns."""
        with table_errors(self.path):
            batch_rows = 1 << 12  # in memory at once, possibly with all of their columns
            # A loop would keep a batch alive while the next one is read.
            yield from map(
                _validate_rows, batches_of(self._file, batch_rows, names and list(names))
            )

    @cached_property
    def run_ids(self) -> pa.Array:
        """(runs,) the ids of the runs."""
        parts = [ids for _, ids in self.parts("run_id")]
        return pa.chunked_array(parts, pa.string()).combine_chunks()

    def read_ids(self) -> NDArray[np.uint64]:
        """Return (runs,) the ids of the runs as 64-bit numbers."""
        all_ids = np.empty(self.runs, np.uint64)
        for rows, ids in self.parts("run_id"):
            all_ids[rows] = self._id_numbers(ids)
        return all_ids

    def plan_hash(self, seeds: int) -> str:
        """Return the hash of the plan with all of these runs, with `seeds` seeds per row."""
        return hash_of_ids(
            self._id_numbers(rows["run_id"])[numpy_array(rows["index"]) % seeds == 0]
            for rows in self.iterate_batches(["run_id", "index"])
        )

    def _id_numbers(self, ids: pa.Array) -> NDArray[np.uint64]:
        # Start and end of each text in the letters.
        bounds = np.frombuffer(ids.buffers()[1] or bytes(4), np.int32)
        places, letters = bounds[ids.offset : ids.offset + len(ids) + 1], ids.buffers()[2]
        id_digits = 16
        if ids.null_count or (np.diff(places) != id_digits).any():
            raise StoreError(f"{self.path} is damaged: ids of runs have {id_digits} digits")
        digits = np.frombuffer(letters or b"", np.uint8)[slice(*places[[0, -1]])]
        # In ASCII, letters are 9 more than their last four bits.
        values = (digits & 15) + 9 * (digits >> 6)
        return (values[0::2] << 4 | values[1::2]).view(">u8").astype(np.uint64)

    def run_id(self, row: int) -> str:
        """Return the id of a run."""
        return str(self.select_values(["run_id"], [row])[0]["run_id"])

    def place_of(self, run: str) -> int | None:
        """Return the row of a run by its id; None if it does not exist."""
        for rows, ids in self.parts("run_id"):
            if (place := ids.index(text_scalar(run)).as_py()) >= 0:
                return rows.start + place
        return None

    @cached_property
    def axis_names(self) -> tuple[str, ...]:
        """The names of the swept axes, in table order."""
        used_names = set[str]()
        for _, lists in self.parts("axis_names"):
            used_names.update(compute_digests("list_flatten", lists).unique().to_pylist())
        return tuple(name for name in self.schema.names if name in used_names)

    def varies(self, name: str) -> bool:
        """Return whether a column has more than one value; null counts as a value."""
        values = set[Any]()
        for _, column in self.parts(name):
            values.update(_python_values(column.unique()))
            if len(values) > 1:
                return True
        return False

    def is_number(self, name: str) -> bool:
        """Return whether a column holds numbers or booleans."""
        kind = self.schema.field(name).type
        return pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_boolean(kind)

    def has_value(self, name: str) -> NDArray[np.bool_]:
        """Return (runs,) whether a column has a value."""
        is_present = np.empty(self.runs, np.bool_)
        for rows, column in self.parts(name):
            is_present[rows] = numpy_array(compute_digests("is_valid", column))
        return is_present

    def has_any(self, name: str) -> bool:
        """Return whether a column has any value."""
        return any(part.null_count < len(part) for _, part in self.parts(name))

    def has_finite(self, name: str) -> bool:
        """Return whether a numeric column has any finite value."""
        return any(np.isfinite(_number_column(part).values).any() for _, part in self.parts(name))

    def numbers(self, name: str) -> NumberColumn:
        """Return a column of numbers, or of booleans as 1 and 0."""
        values, valid = np.empty(self.runs), np.ones(self.runs, np.bool_)
        for rows, column in self.parts(name):
            if column.null_count:
                values[rows], valid[rows] = _number_column(column)
            else:
                values[rows] = numpy_array(column)
        return NumberColumn(values, valid)

    def rank_numbers(
        self, name: str, also: Sequence[float] = ()
    ) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """Return the distinct numbers of a column and `also`, and the index of each run's number.

        They ascend, and end with NaN if any run (n,) has no value.
        """
        different = [np.unique(_number_column(column).values) for _, column in self.parts(name)]
        values = np.unique(np.concatenate([np.array(also, float), *different]))
        places = np.empty(self.runs, np.int32)
        for rows, column in self.parts(name):
            places[rows] = np.searchsorted(values, _number_column(column).values)
        return values, places

    def read_codes(self, name: str) -> CodedColumn:
        """Return a column by its stored codes, without expanding its text."""
        codes_of_runs, codes_by_word, nulls = np.empty(self.runs, np.int32), dict[Any, int](), False
        by_codes = pq.ParquetFile(self._source, metadata=self._metadata, read_dictionary=[name])
        for rows, column in self.parts(name, by_codes):
            dictionary = column.dictionary_encode()
            words = _python_values(dictionary.dictionary)
            codes = np.array(
                [codes_by_word.setdefault(word, len(codes_by_word)) for word in words], np.int32
            )
            is_valid = numpy_array(compute_digests("is_valid", dictionary.indices))
            nulls = nulls or not is_valid.all()
            codes_of_runs[rows] = -1
            codes_of_runs[rows][is_valid] = codes[numpy_array(dictionary.indices)[is_valid]]
        codes_of_runs[codes_of_runs < 0] = len(codes_by_word)
        return CodedColumn(codes_of_runs, (*codes_by_word, *([None] if nulls else [])))

    def string_sets(self, name: str) -> tuple[NDArray[np.int64], tuple[str, ...]]:
        """Return a column of lists of strings as bit masks, and the strings, at most 64.

        Bit i of a mask (n,) tells whether string i is in the list.
        """
        masks, bits_by_word = np.zeros(self.runs, np.int64), dict[str, int]()
        for rows, lists in self.parts(name):
            entries = compute_digests("list_flatten", lists).dictionary_encode()
            words = [
                bits_by_word.setdefault(word, len(bits_by_word))
                for word in entries.dictionary.to_pylist()
            ]
            # A bit each in a 64-bit mask.
            if len(bits_by_word) > 64:
                raise StoreError(
                    f"{self.path} is damaged: {len(bits_by_word)} different strings in '{name}'"
                )
            bits = (np.int64(1) << np.array(words, np.int64))[numpy_array(entries.indices)]
            places = numpy_array(compute_digests("list_parent_indices", lists))
            np.bitwise_or.at(masks[rows], places, bits)
        return masks, tuple(bits_by_word)

    def byte_strings(self, name: str) -> NDArray[np.bytes_]:
        """Return (n,) strings as fixed-length bytes, for ids and hashes; empty for nulls."""
        width = 1
        texts = np.empty(self.runs, f"S{width}")
        for rows, column in self.parts(name):
            longest = compute_digests("max", compute_digests("binary_length", column)).as_py() or 1
            if longest > width:
                width = longest
                texts = texts.astype(f"S{width}")
            filled = compute_digests("coalesce", column, text_scalar(""))
            padded_texts = compute_digests("utf8_rpad", filled, options=pc.PadOptions(width, "\0"))
            texts[rows] = np.frombuffer(padded_texts.buffers()[2], texts.dtype, len(padded_texts))
        return texts

    def identify(self, rows: Sequence[int]) -> list[dict[str, Any]]:
        """Return run id, seed and axis values of some runs."""
        return self.select_values(["run_id", "seed", *self.axis_names], rows)

    def select_values(self, names: Sequence[str], rows: Sequence[int]) -> list[dict[str, Any]]:
        """Return the values of some runs in some columns, reading each needed row group once."""
        of_row: dict[int, dict[str, Any]] = {}
        with table_errors(self.path):
            for row in sorted({*rows}):
                start, part = self._find_part(row, tuple(names))
                (of_row[row],) = part.slice(row - start, 1).to_pylist()
        return [{**of_row[row]} for row in rows]

    def _find_part(self, row: int, names: tuple[str, ...]) -> tuple[int, pa.RecordBatch]:
        """Return the first row, and the content, of the part of a row group with a row."""
        group = int(np.searchsorted(self._group_ends, row, side="right"))
        first = int(self._group_ends[group - 1]) if group else 0
        number = (row - first) // GROUP
        return first + number * GROUP, self._part_of(group, number, names)

    @cached_property
    def _group_ends(self) -> NDArray[np.int64]:
        meta = self._metadata
        sizes = [meta.row_group(group).num_rows for group in range(meta.num_row_groups)]
        return np.cumsum(np.array(sizes, np.int64))

    def to_pydict(self, names: Sequence[str]) -> dict[str, list[Any]]:
        """Return some columns as lists of Python values, None for nulls."""
        return self.read_arrow(names).to_pydict()

    def values(self, name: str) -> set[Any]:
        """Return the distinct values of a column, with None for nulls."""
        return {
            value
            for part in self.iterate_batches([name])
            for value in _python_values(part[0].unique())
        }

    def iterate_distinct(self, names: Sequence[str]) -> Iterator[dict[str, Any]]:
        """Yield the distinct values of rows in some columns, for some rows at a time."""
        with table_errors(self.path):
            for rows in batches_of(self._file, GROUP, [*names]):
                columns = rows.to_pydict()
                for values in dict.fromkeys(zip(*columns.values(), strict=True)):
                    yield dict(zip(columns, values, strict=True))

    def iterate_present(self, names: Sequence[str]) -> Iterator[dict[str, Any]]:
        """Yield the values of rows in some columns if the first is not null, likewise."""
        with table_errors(self.path):
            for rows in batches_of(self._file, GROUP, [*names]):
                part = rows.select([*names])
                is_there = compute_digests("is_valid", part.column(0))
                yield from compute_digests("filter", part, is_there).to_pylist()

    def rows_at(self, rows: Sequence[int]) -> Iterator[dict[str, Any]]:
        """Yield some whole rows in table order, with a few of them in memory at a time."""
        chosen = np.zeros(self.runs, np.bool_)
        chosen[[*rows]] = True
        yield from iterate_rows(Path(self._source), chosen)

    def read_row(self, index: int) -> dict[str, Any]:
        """Return one row of the table, reading only its row group."""
        return self.select_values(self.schema.names, [index])[0]

    def parts(
        self, name: str, file: pq.ParquetFile | None = None
    ) -> Iterator[tuple[slice, pa.Array]]:
        """Yield a column some rows at a time, each part with its rows.

        Numbers come in larger parts than texts, since a reader takes a while to start.
        """
        if name not in self.schema.names:
            raise StoreError(f"{self.path} has no column '{name}'")
        stop = 0
        with table_errors(self.path):
            size = NUMBERS if self.is_number(name) else GROUP
            for batch in batches_of(file or self._file, size, [name]):
                start, stop = stop, stop + len(batch)
                yield slice(start, stop), batch.column(0)

    def read_between(self, name: str, rows: slice) -> pa.ChunkedArray:
        """Return a column of consecutive rows, reading only their row groups."""
        parts, at = list[pa.Array](), rows.start
        with table_errors(self.path):
            while at < rows.stop:
                start, part = self._find_part(at, (name,))
                parts.append(part.column(0).slice(at - start, rows.stop - at))
                at = start + len(part)
        return pa.chunked_array(parts)

    def _read_part(self, group: int, number: int, names: tuple[str, ...]) -> pa.RecordBatch:
        parts = batches_of(self._file, GROUP, names, groups=[group])
        return next(islice(parts, number, None))


def equal_texts(one: RunColumns, other: RunColumns, name: str) -> NDArray[np.bool_]:
    """Return (runs,) whether a text column is equal, and not null, in two equally long tables."""
    equal = np.zeros(one.runs, np.bool_)
    for rows, ours in one.parts(name):
        theirs = other.read_between(name, rows)
        both = compute_digests(
            "and", compute_digests("is_valid", ours), compute_digests("is_valid", theirs)
        )
        equal[rows] = numpy_array(both) & numpy_array(compute_digests("equal", ours, theirs))
    return equal


def places_among(
    values: NDArray[np.integer[Any]], among: NDArray[np.integer[Any]]
) -> NDArray[np.intp]:
    """Return (n,) the place of each integer among others (m,), -1 where it is not there."""
    lookup = pc.SetLookupOptions(value_set=number_array(among))
    found = compute_digests("index_in", number_array(values), options=lookup)
    is_there = numpy_array(compute_digests("is_valid", found))
    return np.where(is_there, numpy_array(found), -1).astype(np.intp)


_Rows = TypeVar("_Rows", pa.RecordBatch, pa.Array)


def select_rows(
    batches: Iterator[pa.RecordBatch], chosen: NDArray[np.bool_] | None
) -> Iterator[pa.RecordBatch]:
    """Yield the rows of batches, or only the `chosen` ones (runs,), some at a time."""
    if chosen is None:
        yield from batches
        return
    start = 0
    for batch in batches:
        if (rows := rows_of(batch, chosen[start:][: len(batch)])).num_rows:
            yield rows
        start += len(batch)


def _number_column(column: pa.Array) -> NumberColumn:
    if column.null_count in {0, len(column)}:
        valid = np.full(len(column), column.null_count == 0)
        numbers = numpy_array(column) if valid.any() else np.full(len(column), np.nan)
        return NumberColumn(numbers.astype(float, copy=False), valid)
    valid = numpy_array(compute_digests("is_valid", column))
    return NumberColumn(np.where(valid, numpy_array(column), np.nan), valid)


def _python_values(values: pa.Array) -> list[Any]:
    """Return values as Python objects; NaN become one object, because NaN equals no other."""
    return [math.nan if value != value else value for value in values.to_pylist()]  # noqa: PLR0124


def _validate_rows(rows: pa.RecordBatch) -> pa.RecordBatch:
    rows.validate(full=True)
    return rows


def rows_of(rows: _Rows, is_wanted: NDArray[np.bool_]) -> _Rows:
    """Return the wanted (n,) rows, or entries of a column."""
    return compute_digests("take", rows, number_array(np.flatnonzero(is_wanted)))


def hash_of_ids(parts: Iterable[NDArray[np.uint64]]) -> str:
    """Return the hash of run ids in an order; for the first run of each row it is that of the plan.

    They come in parts (n,), each converted to text some ids at a time.
    """
    digest = hashlib.sha256()
    hash_block = 1 << 16  # 1 MiB of text
    for ids in parts:
        for first in range(0, len(ids), hash_block):
            digest.update(ids[first : first + hash_block].astype(">u8").tobytes().hex().encode())
    return digest.hexdigest()[:32]
