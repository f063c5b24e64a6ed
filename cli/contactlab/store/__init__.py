"""The store: traces in MCAP, one table in Parquet, a manifest written last."""

from contactlab.store.address import SCHEMES, Address, ObjectAddress, absolute, located
from contactlab.store.arrays import Measured, Numbers, RunColumns, Words
from contactlab.store.baseline import write_baseline
from contactlab.store.columns import (
    RESERVED,
    Column,
    axis_column,
    metric_column,
    ratios,
    struct_column,
)
from contactlab.store.files import TEMPORARY, cannot_write, replacing, sha256_of
from contactlab.store.identity import read_manifest
from contactlab.store.rows import SHARED, from_row, to_row
from contactlab.store.store import Store, open  # noqa: A004 - read as store.open
from contactlab.store.traces import TraceFolder
from contactlab.store.verify import verify
from contactlab.store.viewing import export_mcap, export_rrd
from contactlab.store.writer import SCENES, TRACES, StoreWriter, writing

__all__ = [
    "RESERVED",
    "SCENES",
    "SCHEMES",
    "SHARED",
    "TEMPORARY",
    "TRACES",
    "Address",
    "Column",
    "Measured",
    "Numbers",
    "ObjectAddress",
    "RunColumns",
    "Store",
    "StoreWriter",
    "TraceFolder",
    "Words",
    "absolute",
    "axis_column",
    "cannot_write",
    "export_mcap",
    "export_rrd",
    "from_row",
    "located",
    "metric_column",
    "open",
    "ratios",
    "read_manifest",
    "replacing",
    "sha256_of",
    "struct_column",
    "to_row",
    "verify",
    "write_baseline",
    "writing",
]
