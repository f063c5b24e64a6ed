"""The table's columns as NumPy arrays, each read when it is asked for."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from contactlab.errors import StoreError
from contactlab.store.runs_table import TABLE, shared_fields, table_errors
from contactlab.store.store_address import Address

_MOST_WORDS = 64


@dataclass(frozen=True)
class MeasuredColumn:
    """What a stored column of measured values says of itself.

    Attributes:
        name: its name.
        unit: its unit.
        better: lower, higher or none.
        resolution: magnitude below which a value is 0, in its unit.
        second_pass: whether it is measured in the second pass.
    """

    name: str
    unit: str
    better: str
    resolution: float
    second_pass: bool


class NumberColumn(NamedTuple):
    """A column of numbers.

    Attributes:
        values: (n,), NaN where there is none.
        given: (n,), whether there is one; what is given may be NaN too.
    """

    values: NDArray[np.float64]
    given: NDArray[np.bool_]

    def at(self, rows: NDArray[np.intp]) -> "NumberColumn":
        """Return the numbers of some rows."""
        return NumberColumn(self.values[rows], self.given[rows])


class StringColumn(NamedTuple):
    """A column of words, or of lists of them.

    Attributes:
        codes: (n,) the place of a run's word in `words`, -1 for none; of lists a mask, whose bit
            i says that word i is in it.
        words: the words that occur.
    """

    codes: NDArray[np.int64]
    words: tuple[str, ...]


class RunColumns:
    """The table of a store, column by column.

    Args:
        store: the folder that holds it.
        named: what messages call the store, if it is not that folder.

    Raises:
        StoreError: there is no table, it is damaged, or it lacks a column that was asked for.
    """

    def __init__(self, store: Path, named: Address | None = None) -> None:
        self.path = (store if named is None else named) / TABLE
        with table_errors(self.path):
            self._file = pq.ParquetFile(store / TABLE)
        self._last: tuple[int, pa.Table] | None = None

    @property
    def runs(self) -> int:
        """How many runs there are."""
        return self._file.metadata.num_rows

    @cached_property
    def schema(self) -> pa.Schema:
        """The columns' types and metadata."""
        return self._file.schema_arrow

    @cached_property
    def shared(self) -> Mapping[str, Any]:
        """What all runs have in common."""
        return shared_fields(self.schema)

    @cached_property
    def measured(self) -> Mapping[str, MeasuredColumn]:
        """The columns of measured values by name, in their order."""
        found = (_measured(field) for field in self.schema)
        return {each.name: each for each in found if each.better}

    @cached_property
    def axis_names(self) -> tuple[str, ...]:
        """The names of the axes that runs were swept over, in the table's order."""
        used = set(self._read("axis_names").flatten().unique().to_pylist())
        return tuple(name for name in self.schema.names if name in used)

    def is_number(self, name: str) -> bool:
        """Tell whether a column holds numbers or truth values."""
        kind = self.schema.field(name).type
        return pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_boolean(kind)

    def numbers(self, name: str) -> NumberColumn:
        """Return a column of numbers, or of truth values as 1 and 0."""
        column = self._read(name)
        given = np.asarray(column.is_valid())
        values = column.cast(pa.float64()).to_numpy(zero_copy_only=False)
        return NumberColumn(values, given)

    def words(self, name: str) -> StringColumn:
        """Return a column of words."""
        encoded = self._read(name).dictionary_encode()
        codes = encoded.indices.fill_null(-1).to_numpy(zero_copy_only=False)
        return StringColumn(codes.astype(np.int64), tuple(encoded.dictionary.to_pylist()))

    def word_sets(self, name: str) -> StringColumn:
        """Return a column of lists of words, of which at most 64 differ."""
        lists = self._read(name)
        encoded = lists.flatten().dictionary_encode()
        words = tuple(encoded.dictionary.to_pylist())
        if len(words) > _MOST_WORDS:
            raise StoreError(f"{self.path} is damaged: {len(words)} different words in '{name}'")
        bits = np.int64(1) << np.asarray(encoded.indices).astype(np.int64)
        masks = np.zeros(self.runs, dtype=np.int64)
        rows = np.asarray(lists.value_parent_indices())
        np.bitwise_or.at(masks, rows, bits)
        return StringColumn(masks, words)

    def keys(self, name: str) -> NDArray[np.bytes_]:
        """Return (n,) words as bytes of one length, for hashes; empty where there is none."""
        column = self._read(name).fill_null("")
        return column.to_numpy(zero_copy_only=False).astype("S")

    def identify(self, rows: Sequence[int]) -> list[dict[str, Any]]:
        """Return run id, seed and axis values of some runs."""
        return self._identities.take(pa.array(rows, pa.int64())).to_pylist()

    def listed(self, names: Sequence[str]) -> dict[str, list[Any]]:
        """Return some columns as lists of plain values, None where there is none."""
        with table_errors(self.path):
            return self._file.read(columns=list(names)).to_pydict()

    def row(self, place: int) -> dict[str, Any]:
        """Return one run as the table has it, without reading all others."""
        first = 0
        for group in range(self._file.num_row_groups):
            runs = self._file.metadata.row_group(group).num_rows
            if place < first + runs:
                return self._group(group).slice(place - first, 1).to_pylist()[0]
            first += runs
        raise StoreError(f"{self.path} has no row {place}")

    def _group(self, group: int) -> pa.Table:
        """Return one row group; the last one is kept, since rows are asked for in order."""
        if self._last is None or self._last[0] != group:
            with table_errors(self.path):
                self._last = (group, self._file.read_row_group(group))
        return self._last[1]

    @cached_property
    def _identities(self) -> pa.Table:
        with table_errors(self.path):
            return self._file.read(columns=["run_id", "seed", *self.axis_names])

    def _read(self, name: str) -> pa.Array:
        if name not in self.schema.names:
            raise StoreError(f"{self.path} has no column '{name}'")
        with table_errors(self.path):
            column = self._file.read(columns=[name]).column(0)
        return column.combine_chunks() if column.num_chunks != 1 else column.chunk(0)


def _measured(field: pa.Field) -> MeasuredColumn:
    meta = {key.decode(): text.decode() for key, text in (field.metadata or {}).items()}
    return MeasuredColumn(
        field.name,
        meta.get("unit", ""),
        meta.get("better", ""),
        float(meta.get("resolution", 0)),
        "measured_in" in meta,
    )
