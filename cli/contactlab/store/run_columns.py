"""The table's columns as NumPy arrays, each read on demand."""

import hashlib
import math
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
    batches_of,
    compute,
    listed_columns,
    shared_fields,
    table_errors,
)
from contactlab.store.store_files import TABLE, Address, stored_file
from contactlab.store.table_layout import Column, column_of

_ID_DIGITS = 16
_BATCH = 1 << 12
"""Rows that are in memory at once, where all of their columns may be."""
_MOST_PARTS = 4  # parts of rows that are kept for who asks for rows next to each other
_HASHED = 1 << 16  # ids that are written out at once
_MOST_CATEGORIES = 64  # a bit each in a 64-bit mask


class NumberColumn(NamedTuple):
    """A column of numbers."""

    values: NDArray[np.float64]  # (n,) NaN where there is none
    valid: NDArray[np.bool_]  # (n,) whether there is one; a valid value may be NaN too

    def at(self, rows: NDArray[np.integer[Any]] | slice) -> "NumberColumn":
        """Return the numbers of some rows."""
        return NumberColumn(self.values[rows], self.valid[rows])


class CodedColumn(NamedTuple):
    """A column with each of its values once."""

    codes: NDArray[np.integer]  # (n,) index of a run's value in `values`
    values: tuple[Any, ...]  # those that occur, at last None if runs have none


class RunColumns:
    """The table in the folder of a store, read column by column on demand.

    A StoreError, which names the store's address, says that there is no table, that it is damaged,
    or that it lacks a requested column.
    """

    def __init__(self, store: Path, address: Address | None = None) -> None:
        self.path = (address or store) / TABLE
        with table_errors(self.path):
            self._source = stored_file(store, TABLE) or store / TABLE
            self._file = pq.ParquetFile(self._source)
        self._part_of = lru_cache(_MOST_PARTS)(self._read_part)

    @property
    def runs(self) -> int:
        """The number of runs."""
        return self._file.metadata.num_rows

    @cached_property
    def schema(self) -> pa.Schema:
        """The columns' types and metadata."""
        return self._file.schema_arrow

    @cached_property
    def shared(self) -> Mapping[str, Any]:
        """The fields that all runs share."""
        return shared_fields(self.schema)

    @cached_property
    def listed(self) -> Mapping[str, Any]:
        """What the file says of its columns for readers of no Arrow; empty if it says nothing."""
        return listed_columns(self.schema)

    @cached_property
    def described(self) -> Mapping[str, Column]:
        """All columns by name, in table order."""
        return {column.name: column for column in map(column_of, self.schema)}

    @cached_property
    def measured(self) -> Mapping[str, Column]:
        """The columns of measured values by name, in table order."""
        return {name: column for name, column in self.described.items() if column.better}

    def arrow(self, names: Sequence[str] | None = None) -> pa.Table:
        """Return the table, or some of its columns."""
        with table_errors(self.path):
            table = self._file.read(names and list(names), use_threads=False)
            # Text that is no UTF-8 is damage too.
            table.validate(full=True)
            return table

    def batches(self, names: Sequence[str] | None = None) -> Iterator[pa.RecordBatch]:
        """Yield some thousand rows at a time, or some of their columns."""
        with table_errors(self.path):
            # Not in a loop, which would hold a batch while the next one is read.
            yield from map(_validated, batches_of(self._file, _BATCH, names and list(names)))

    @cached_property
    def run_ids(self) -> pa.Array:
        """(runs,) the ids of the runs."""
        parts = [ids for _, ids in self.parts("run_id")]
        return pa.chunked_array(parts, pa.string()).combine_chunks()

    def ids(self) -> NDArray[np.uint64]:
        """Return (runs,) the ids of the runs, as the numbers of 64 bits that they write."""
        found = np.empty(self.runs, np.uint64)
        for rows, ids in self.parts("run_id"):
            found[rows] = self._id_numbers(ids)
        return found

    def plan_hash(self, seeds: int) -> str:
        """Return the hash of the plan whose runs these are all, where a row has so many seeds."""
        return hash_of_ids(
            self._id_numbers(rows["run_id"])[numpy_array(rows["index"]) % seeds == 0]
            for rows in self.batches(["run_id", "index"])
        )

    def _id_numbers(self, ids: pa.Array) -> NDArray[np.uint64]:
        places, letters = _places(ids), ids.buffers()[2]
        if ids.null_count or (np.diff(places) != _ID_DIGITS).any():
            raise StoreError(f"{self.path} is damaged: ids of runs have {_ID_DIGITS} digits")
        digits = np.frombuffer(letters or b"", np.uint8)[slice(*places[[0, -1]])]
        # In ASCII, letters are 9 more than their last four bits.
        values = (digits & 15) + 9 * (digits >> 6)
        return (values[0::2] << 4 | values[1::2]).view(">u8").astype(np.uint64)

    def run_id(self, row: int) -> str:
        """Return the id of a run."""
        return str(self.some(["run_id"], [row])[0]["run_id"])

    def place_of(self, run: str) -> int | None:
        """Return the row of a run, given its id; None if there is none."""
        for rows, ids in self.parts("run_id"):
            if (place := ids.index(text_scalar(run)).as_py()) >= 0:
                return rows.start + place
        return None

    @cached_property
    def axis_names(self) -> tuple[str, ...]:
        """The names of the swept axes, in table order."""
        used = set[str]()
        for _, lists in self.parts("axis_names"):
            used.update(compute("list_flatten", lists).unique().to_pylist())
        return tuple(name for name in self.schema.names if name in used)

    def varies(self, name: str) -> bool:
        """Return whether a column has more than one value, none being one."""
        found = set[Any]()
        for _, column in self.parts(name):
            found.update(_listed(column.unique()))
            if len(found) > 1:
                return True
        return False

    def is_number(self, name: str) -> bool:
        """Return whether a column holds numbers or booleans."""
        kind = self.schema.field(name).type
        return pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_boolean(kind)

    def given(self, name: str) -> NDArray[np.bool_]:
        """Return (runs,) whether a column holds anything."""
        found = np.empty(self.runs, np.bool_)
        for rows, column in self.parts(name):
            found[rows] = numpy_array(compute("is_valid", column))
        return found

    def has_finite(self, name: str) -> bool:
        """Return whether a column of numbers holds any that is finite."""
        return any(np.isfinite(_numbers_of(part).values).any() for _, part in self.parts(name))

    def numbers(self, name: str) -> NumberColumn:
        """Return a column of numbers, or of booleans as 1 and 0."""
        values, valid = np.empty(self.runs), np.empty(self.runs, np.bool_)
        for rows, column in self.parts(name):
            values[rows], valid[rows] = _numbers_of(column)
        return NumberColumn(values, valid)

    def ranked(
        self, name: str, also: Sequence[float] = ()
    ) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """Return the different numbers of a column and some others, and the place of each run's.

        They ascend, and end with NaN if any run (n,) has none.
        """
        different = [np.unique(_numbers_of(column).values) for _, column in self.parts(name)]
        values = np.unique(np.concatenate([np.array(also, float), *different]))
        places = np.empty(self.runs, np.int32)
        for rows, column in self.parts(name):
            places[rows] = np.searchsorted(values, _numbers_of(column).values)
        return values, places

    def coded(self, name: str) -> CodedColumn:
        """Return a column by the codes that it is stored with, its text not written out."""
        found, known, nulls = np.empty(self.runs, np.int32), dict[Any, int](), False
        by_codes = pq.ParquetFile(
            self._source, metadata=self._file.metadata, read_dictionary=[name]
        )
        for rows, column in self.parts(name, by_codes):
            encoded = column.dictionary_encode()
            words = _listed(encoded.dictionary)
            codes = np.array([known.setdefault(word, len(known)) for word in words], np.int32)
            given = numpy_array(compute("is_valid", encoded.indices))
            nulls = nulls or not given.all()
            found[rows] = -1
            found[rows][given] = codes[numpy_array(encoded.indices)[given]]
        found[found < 0] = len(known)
        return CodedColumn(found, (*known, *([None] if nulls else [])))

    def string_sets(self, name: str) -> tuple[NDArray[np.int64], tuple[str, ...]]:
        """Return a column of lists of strings, and the strings, of which there are at most 64.

        It is (n,) a bit mask, whose bit i says whether string i is in the list.
        """
        masks, known = np.zeros(self.runs, np.int64), dict[str, int]()
        for rows, lists in self.parts(name):
            entries = compute("list_flatten", lists).dictionary_encode()
            words = [known.setdefault(word, len(known)) for word in entries.dictionary.to_pylist()]
            if len(known) > _MOST_CATEGORIES:
                raise StoreError(
                    f"{self.path} is damaged: {len(known)} different strings in '{name}'"
                )
            bits = (np.int64(1) << np.array(words, np.int64))[numpy_array(entries.indices)]
            places = numpy_array(compute("list_parent_indices", lists))
            np.bitwise_or.at(masks[rows], places, bits)
        return masks, tuple(known)

    def byte_strings(self, name: str) -> NDArray[np.bytes_]:
        """Return (n,) strings as fixed-length bytes, for ids and hashes; empty where null."""
        lengths = (compute("binary_length", column) for _, column in self.parts(name))
        width = max((compute("max", part).as_py() or 1 for part in lengths), default=1)
        found = np.empty(self.runs, f"S{width}")
        for rows, column in self.parts(name):
            filled = compute("coalesce", column, text_scalar(""))
            padded = compute("utf8_rpad", filled, options=pc.PadOptions(width, "\0"))
            found[rows] = np.frombuffer(padded.buffers()[2], found.dtype, len(padded))
        return found

    def identify(self, rows: Sequence[int]) -> list[dict[str, Any]]:
        """Return run id, seed and axis values of some runs."""
        return self.some(["run_id", "seed", *self.axis_names], rows)

    def some(self, names: Sequence[str], rows: Sequence[int]) -> list[dict[str, Any]]:
        """Return what some runs have in some columns, reading no more than their row groups."""
        found: list[dict[str, Any]] = []
        with table_errors(self.path):
            for row in rows:
                start, part = self._holding(row, tuple(names))
                found += part.slice(row - start, 1).to_pylist()
        return found

    def _holding(self, row: int, names: tuple[str, ...]) -> tuple[int, pa.RecordBatch]:
        """Return the part of a row group that has a row, and its first row."""
        group = int(np.searchsorted(self._ends, row, side="right"))
        first = int(self._ends[group - 1]) if group else 0
        number = (row - first) // GROUP
        return first + number * GROUP, self._part_of(group, number, names)

    @cached_property
    def _ends(self) -> NDArray[np.int64]:
        """Where each row group ends."""
        meta = self._file.metadata
        sizes = [meta.row_group(group).num_rows for group in range(meta.num_row_groups)]
        return np.cumsum(np.array(sizes, np.int64))

    def to_pydict(self, names: Sequence[str]) -> dict[str, list[Any]]:
        """Return some columns as lists of Python values, None where null."""
        return self.arrow(names).to_pydict()

    def values(self, name: str) -> set[Any]:
        """Return what a column holds, None where it holds nothing."""
        return {value for part in self.batches([name]) for value in _listed(part[0].unique())}

    def distinct(self, names: Sequence[str]) -> Iterator[dict[str, Any]]:
        """Yield what rows hold in some columns, some rows at a time, and of these each once."""
        with table_errors(self.path):
            for rows in batches_of(self._file, GROUP, [*names]):
                columns = rows.to_pydict()
                for values in dict.fromkeys(zip(*columns.values(), strict=True)):
                    yield dict(zip(columns, values, strict=True))

    def present(self, names: Sequence[str]) -> Iterator[dict[str, Any]]:
        """Yield what rows hold in some columns where the first is not null, likewise."""
        with table_errors(self.path):
            for rows in batches_of(self._file, GROUP, [*names]):
                part = rows.select([*names])
                is_there = compute("is_valid", part.column(0))
                yield from compute("filter", part, is_there).to_pylist()

    def row(self, index: int) -> dict[str, Any]:
        """Return one row of the table, reading no more than its row group."""
        return self.some(self.schema.names, [index])[0]

    def parts(
        self, name: str, file: pq.ParquetFile | None = None
    ) -> Iterator[tuple[slice, pa.Array]]:
        """Yield a column some rows at a time, with the rows that each part has."""
        if name not in self.schema.names:
            raise StoreError(f"{self.path} has no column '{name}'")
        stop = 0
        with table_errors(self.path):
            for batch in batches_of(file or self._file, GROUP, [name]):
                start, stop = stop, stop + len(batch)
                yield slice(start, stop), batch.column(0)

    def between(self, name: str, rows: slice) -> pa.ChunkedArray:
        """Return a column of the rows from one to another, reading no more than their groups."""
        parts, at = list[pa.Array](), rows.start
        with table_errors(self.path):
            while at < rows.stop:
                start, part = self._holding(at, (name,))
                parts.append(part.column(0).slice(at - start, rows.stop - at))
                at = start + len(part)
        return pa.chunked_array(parts)

    def _read_part(self, group: int, number: int, names: tuple[str, ...]) -> pa.RecordBatch:
        parts = batches_of(self._file, GROUP, names, groups=[group])
        return next(islice(parts, number, None))


def equal_texts(one: RunColumns, other: RunColumns, name: str) -> NDArray[np.bool_]:
    """Return (runs,) where a column of texts is equal, and there, in two tables of as many runs."""
    equal = np.zeros(one.runs, np.bool_)
    for rows, ours in one.parts(name):
        theirs = other.between(name, rows)
        both = compute("and", compute("is_valid", ours), compute("is_valid", theirs))
        equal[rows] = numpy_array(both) & numpy_array(compute("equal", ours, theirs))
    return equal


_Rows = TypeVar("_Rows", pa.RecordBatch, pa.Array)


def chosen_rows(
    batches: Iterator[pa.RecordBatch], chosen: NDArray[np.bool_] | None
) -> Iterator[pa.RecordBatch]:
    """Return the rows of batches, some at a time, or of them those chosen (runs,)."""
    return batches if chosen is None else _chosen_rows(batches, chosen)


def _chosen_rows(
    batches: Iterable[pa.RecordBatch], chosen: NDArray[np.bool_]
) -> Iterator[pa.RecordBatch]:
    start = 0
    for batch in batches:
        if (rows := rows_of(batch, chosen[start:][: len(batch)])).num_rows:
            yield rows
        start += len(batch)


def _numbers_of(column: pa.Array) -> NumberColumn:
    valid = numpy_array(compute("is_valid", column))
    return NumberColumn(np.where(valid, numpy_array(column), np.nan), valid)


def _listed(values: pa.Array) -> list[Any]:
    """Return values as those of Python; what is not a number, which equals no other, is one."""
    return [math.nan if value != value else value for value in values.to_pylist()]  # noqa: PLR0124


def _validated(rows: pa.RecordBatch) -> pa.RecordBatch:
    rows.validate(full=True)
    return rows


def rows_of(rows: _Rows, wanted: NDArray[np.bool_]) -> _Rows:
    """Return the rows, or entries of a column, (n,) that are wanted."""
    return compute("take", rows, number_array(np.flatnonzero(wanted)))


def hash_of_ids(parts: Iterable[NDArray[np.uint64]]) -> str:
    """Return the hash of the ids of runs in an order; of the first of each row, a plan's.

    They come in parts (n,), of which each is written out some at a time.
    """
    found = hashlib.sha256()
    for ids in parts:
        for first in range(0, len(ids), _HASHED):
            found.update(ids[first : first + _HASHED].astype(">u8").tobytes().hex().encode())
    return found.hexdigest()[:32]


def _places(texts: pa.Array) -> NDArray[np.int32]:
    """Return (n + 1,) where texts begin and end in their letters."""
    places = np.frombuffer(texts.buffers()[1] or bytes(4), np.int32)
    return places[texts.offset : texts.offset + len(texts) + 1]
