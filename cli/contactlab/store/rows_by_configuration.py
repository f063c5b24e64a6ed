"""Groups rows of a store's table by the axes of their runs, so that each group is resolved once."""

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from contactlab.store.arrow_values import number_array, numpy_array, text_scalar
from contactlab.store.row_checks import equal_values, is_null
from contactlab.store.runs_table import compute_digests
from contactlab.store.table_layout import AXES_COLUMN


class RowGroups:
    """Some rows, grouped by equal axes and durations."""

    def __init__(self, rows: pa.RecordBatch) -> None:
        """Group the rows, which have at least their ids, axes and durations."""
        self._rows = rows
        axes = rows[AXES_COLUMN.name]
        codes = _equality_codes(compute_digests("binary_join", axes, text_scalar("\n")))
        for name in ("duration", *{*compute_digests("list_flatten", axes).to_pylist()}):
            codes = _dense_codes(codes * (len(rows) + 1) + _equality_codes(rows[name]))
        _, firsts, group = np.unique(codes, return_index=True, return_inverse=True)
        self._firsts, self._group = firsts, group

    @property
    def names(self) -> list[str]:
        """The columns that the rows have."""
        return self._rows.schema.names

    @cached_property
    def ids(self) -> list[str]:
        """The ids of the runs."""
        return self.column_values("run_id")

    @property
    def firsts(self) -> list[int]:
        """The first row of each group."""
        return self._firsts.tolist()

    @property
    def groups(self) -> list[int]:
        """The group of each row."""
        return self._group.tolist()

    def iterate_groups(self) -> Iterator[list[int]]:
        """Yield the rows of each group."""
        order = np.argsort(self._group, kind="stable")
        for rows in np.split(order, np.cumsum(np.bincount(self._group))[:-1]):
            yield rows.tolist()

    def axes_of_row(self, row: int) -> dict[str, Any]:
        """Return the axis values of a row."""
        return {name: self.value_at(name, row) for name in self.value_at(AXES_COLUMN.name, row)}

    def value_at(self, name: str, row: int) -> Any:  # noqa: ANN401 - of the column's type
        """Return the value of a row in a column."""
        return self._rows[name][row].as_py()

    def column_values(self, name: str) -> list[Any]:
        """Return a column."""
        return self._rows[name].to_pylist()

    def select_columns(self, names: Sequence[str]) -> list[dict[str, Any]]:
        """Return some columns, row by row."""
        if not names:
            return [{} for _ in self.ids]
        return self._rows.select([*names]).to_pylist()

    def differing_rows(self, name: str) -> NDArray[np.bool_]:
        """Return (n,) whether rows differ from their group's first in a column of structs."""
        first, is_different = (
            number_array(self._firsts[self._group]),
            np.zeros(len(self._rows), bool),
        )
        for entry in self._rows[name].flatten():
            is_different |= ~equal_values(entry, compute_digests("take", entry, first))
        return is_different


def _equality_codes(column: pa.Array) -> NDArray[np.int64]:
    """Return (n,) numbers up to n that are equal if values are equal to the bit."""
    if pa.types.is_string(column.type):
        encode = pc.DictionaryEncodeOptions("encode")
        indices = compute_digests("dictionary_encode", column, options=encode).indices
        return numpy_array(indices).astype(np.int64)
    values = numpy_array(column)
    bits = values.view(np.int64) if values.dtype.kind == "f" else values
    return np.where(is_null(column), 0, 1 + _dense_codes(bits))


def _dense_codes(codes: NDArray[Any]) -> NDArray[np.int64]:
    return np.unique(codes, return_inverse=True)[1].astype(np.int64)
