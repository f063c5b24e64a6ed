"""The store: traces in MCAP, one table in Parquet, a manifest written last."""

from contactlab.store.atomic_files import TEMPORARY_SUFFIX, atomic_write, sha256_of, write_error
from contactlab.store.backend_protocol import SCENES, TRACES
from contactlab.store.baseline_store import write_baseline
from contactlab.store.finished_store import Store
from contactlab.store.run_columns import MeasuredColumn, NumberColumn, RunColumns, StringColumn
from contactlab.store.store_access import TraceSink, local_scene
from contactlab.store.store_address import (
    SCHEMES,
    Address,
    ObjectAddress,
    absolute_address,
    parse_address,
)
from contactlab.store.store_writer import StoreWriter, open_writer
from contactlab.store.table_layout import (
    PLUGINS_COLUMN,
    RESERVED_COLUMNS,
    SHARED_FIELDS,
    Column,
    as_ratios,
    axis_column,
    metric_column,
    record_to_row,
    row_to_record,
    struct_column,
)
from contactlab.store.verify_store import verify

__all__ = [
    "PLUGINS_COLUMN",
    "RESERVED_COLUMNS",
    "SCENES",
    "SCHEMES",
    "SHARED_FIELDS",
    "TEMPORARY_SUFFIX",
    "TRACES",
    "Address",
    "Column",
    "MeasuredColumn",
    "NumberColumn",
    "ObjectAddress",
    "RunColumns",
    "Store",
    "StoreWriter",
    "StringColumn",
    "TraceSink",
    "absolute_address",
    "as_ratios",
    "atomic_write",
    "axis_column",
    "local_scene",
    "metric_column",
    "open_writer",
    "parse_address",
    "record_to_row",
    "row_to_record",
    "sha256_of",
    "struct_column",
    "verify",
    "write_baseline",
    "write_error",
]
