"""The table's columns as NumPy arrays, each read on demand."""

from collections.abc import Mapping, Sequence
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from contactlab.errors import StoreError
from contactlab.store.runs_table import shared_fields, table_errors
from contactlab.store.store_files import TABLE, Address, stored_file
from contactlab.store.table_layout import Column, column_of

_MAX_CATEGORIES = 64  # a bit each in a 64-bit mask


class NumberColumn(NamedTuple):
    """A column of numbers."""

    values: NDArray[np.float64]  # (n,) NaN where there is none
    valid: NDArray[np.bool_]  # (n,) whether there is one; a valid value may be NaN too

    def at(self, rows: NDArray[np.intp]) -> "NumberColumn":
        """Return the numbers of some rows."""
        return NumberColumn(self.values[rows], self.valid[rows])


class StringColumn(NamedTuple):
    """A dictionary-encoded column of strings, or of lists of strings."""

    # (n,) index of a run's string in `categories`, -1 for none; of lists a bit mask, whose bit i
    # says whether category i is in the list.
    codes: NDArray[np.int64]
    categories: tuple[str, ...]  # the strings that occur


class RunColumns:
    """The table in the folder of a store, read column by column on demand.

    A StoreError, which names the store's address, says that there is no table, that it is damaged,
    or that it lacks a requested column.
    """

    def __init__(self, store: Path, address: Address | None = None) -> None:
        self.path = (address or store) / TABLE
        with table_errors(self.path):
            self._file = pq.ParquetFile(stored_file(store, TABLE) or store / TABLE)
        # Rows are read in order.
        self._group = lru_cache(maxsize=1)(self._file.read_row_group)

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
    def described(self) -> Mapping[str, Column]:
        """All columns by name, in table order."""
        return {each.name: each for each in map(column_of, self.schema)}

    @cached_property
    def measured(self) -> Mapping[str, Column]:
        """The columns of measured values by name, in table order."""
        return {name: each for name, each in self.described.items() if each.better}

    def arrow(self, names: Sequence[str] | None = None) -> pa.Table:
        """Return the table, or some of its columns."""
        with table_errors(self.path):
            table = self._file.read(names and list(names), use_threads=False)
            # Text that is no UTF-8 is damage too.
            table.validate(full=True)
            return table

    @cached_property
    def run_ids(self) -> pa.Array:
        """(runs,) the ids of the runs."""
        return self._read("run_id")

    @cached_property
    def axis_names(self) -> tuple[str, ...]:
        """The names of the swept axes, in table order."""
        used = set(self._read("axis_names").flatten().unique().to_pylist())
        return tuple(name for name in self.schema.names if name in used)

    def is_number(self, name: str) -> bool:
        """Return whether a column holds numbers or booleans."""
        kind = self.schema.field(name).type
        return pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_boolean(kind)

    def numbers(self, name: str) -> NumberColumn:
        """Return a column of numbers, or of booleans as 1 and 0."""
        column = self._read(name)
        values = column.cast(pa.float64()).to_numpy(zero_copy_only=False)
        return NumberColumn(values, np.asarray(column.is_valid()))

    def strings(self, name: str) -> StringColumn:
        """Return a column of strings."""
        encoded = self._read(name).dictionary_encode()
        codes = encoded.indices.fill_null(-1).to_numpy(zero_copy_only=False)
        return StringColumn(codes.astype(np.int64), tuple(encoded.dictionary.to_pylist()))

    def string_sets(self, name: str) -> StringColumn:
        """Return a column of lists of strings, of at most 64 different ones."""
        lists = self._read(name)
        encoded = lists.flatten().dictionary_encode()
        categories = tuple(encoded.dictionary.to_pylist())
        if len(categories) > _MAX_CATEGORIES:
            count = len(categories)
            raise StoreError(f"{self.path} is damaged: {count} different strings in '{name}'")
        bits = np.int64(1) << np.asarray(encoded.indices).astype(np.int64)
        masks = np.zeros(self.runs, dtype=np.int64)
        rows = np.asarray(lists.value_parent_indices())
        np.bitwise_or.at(masks, rows, bits)
        return StringColumn(masks, categories)

    def byte_strings(self, name: str) -> NDArray[np.bytes_]:
        """Return (n,) strings as fixed-length bytes, for ids and hashes; empty where null."""
        column = self._read(name).fill_null("")
        lengths = pc.call_function("binary_length", [column])
        width = pc.call_function("max", [lengths]).as_py() or 1
        padded = pc.call_function("utf8_rpad", [column], pc.PadOptions(width, "\0"))
        return np.frombuffer(padded.buffers()[2], f"S{width}", len(padded))

    def identify(self, rows: Sequence[int]) -> list[dict[str, Any]]:
        """Return run id, seed and axis values of some runs."""
        return self._identities.take(pa.array(rows, pa.int64())).to_pylist()

    def to_pydict(self, names: Sequence[str]) -> dict[str, list[Any]]:
        """Return some columns as lists of Python values, None where null."""
        return self.arrow(names).to_pydict()

    def row(self, index: int) -> dict[str, Any]:
        """Return one row of the table, reading no more than its row group."""
        with table_errors(self.path):
            for group in range(self._file.num_row_groups):
                runs = self._file.metadata.row_group(group).num_rows
                if index < runs:
                    return self._group(group).slice(index, 1).to_pylist()[0]
                index -= runs
        raise StoreError(f"{self.path} has too few rows")

    @cached_property
    def _identities(self) -> pa.Table:
        return self.arrow(["run_id", "seed", *self.axis_names])

    def _read(self, name: str) -> pa.Array:
        if name not in self.schema.names:
            raise StoreError(f"{self.path} has no column '{name}'")
        with table_errors(self.path):
            column = self._file.read(columns=[name]).column(0)
        return column.combine_chunks() if column.num_chunks != 1 else column.chunk(0)
