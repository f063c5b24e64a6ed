"""A store as a notebook shows it: its runs for data frames, itself as a line or a small table."""

from collections.abc import Iterable
from dataclasses import dataclass
from html import escape
from typing import Any

import pyarrow as pa

from contactlab.errors import optional
from contactlab.schema.evidence import StoreManifest
from contactlab.store.store_address import Address

_SHOWN = ("run_id", "label", "label_reason")
_MOST_ROWS = 20


@dataclass(frozen=True, repr=False)
class Runs:
    """Every run of a store as a row, in plan order.

    Whatever reads Arrow reads it as it is: polars, DuckDB and pandas take it by the Arrow
    PyCapsule interface.

    Attributes:
        arrow: the table; units and descriptions are in the metadata of its fields.
    """

    arrow: pa.Table

    def to_pandas(self) -> Any:  # noqa: ANN401 - pandas is not a dependency
        """Return a pandas DataFrame.

        Raises:
            OutputError: pandas is not installed.
        """
        with optional("frames", "to_pandas()"):
            return self.arrow.to_pandas()

    def to_polars(self) -> Any:  # noqa: ANN401 - polars is not a dependency
        """Return a polars DataFrame.

        Raises:
            OutputError: polars is not installed.
        """
        with optional("frames", "to_polars()"):
            import polars as pl  # noqa: PLC0415 - is not a dependency
        return pl.from_arrow(self.arrow)

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        return self.arrow.__arrow_c_stream__(requested_schema)

    def __len__(self) -> int:
        return self.arrow.num_rows

    def __repr__(self) -> str:
        return f"<{len(self)} runs, {self.arrow.num_columns} columns>"

    def _repr_html_(self) -> str:
        rows = self.arrow.select(list(_SHOWN)).slice(0, _MOST_ROWS).to_pylist()
        more = f"<p>and {len(self) - _MOST_ROWS:,} more</p>" if len(self) > _MOST_ROWS else ""
        return _table(_SHOWN, (row.values() for row in rows)) + more


def store_line(address: Address, manifest: StoreManifest) -> str:
    """Return a store in one line: where it is, and its runs by label."""
    labels = ", ".join(f"{count} {label}" for label, count in manifest.labels.items())
    return f"<store {address}: {manifest.runs} runs of {manifest.sweep.scene}: {labels}>"


def store_table(address: Address, manifest: StoreManifest) -> str:
    """Return a store as a small HTML table: its runs by label."""
    scene = escape(manifest.sweep.scene)
    head = f"<p><b>{escape(str(address))}</b>: {manifest.runs} runs of {scene}</p>"
    return head + _table(("label", "runs"), manifest.labels.items())


def _table(header: Iterable[object], rows: Iterable[Iterable[object]]) -> str:
    return f"<table>{_row('th', header)}{''.join(_row('td', each) for each in rows)}</table>"


def _row(tag: str, cells: Iterable[object]) -> str:
    return f"<tr>{''.join(f'<{tag}>{escape(str(cell))}</{tag}>' for cell in cells)}</tr>"
