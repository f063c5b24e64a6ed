"""The store: traces in MCAP, one table in Parquet, a manifest written last."""

from contactlab.evidence.columns import (
    RESERVED,
    Column,
    axis_column,
    metric_column,
    struct_column,
)
from contactlab.evidence.files import cannot_write, sha256_of
from contactlab.evidence.identity import read_manifest
from contactlab.evidence.mcap import (
    StoredTrace,
    TraceExtras,
    TraceSummary,
    check_trace,
    read_trace,
    write_trace,
)
from contactlab.evidence.rows import SHARED, from_row, to_row
from contactlab.evidence.store import Store
from contactlab.evidence.verify import verify
from contactlab.evidence.writer import SCENES, TRACES, StoreWriter, writing

__all__ = [
    "RESERVED",
    "SCENES",
    "SHARED",
    "TRACES",
    "Column",
    "Store",
    "StoreWriter",
    "StoredTrace",
    "TraceExtras",
    "TraceSummary",
    "axis_column",
    "cannot_write",
    "check_trace",
    "from_row",
    "metric_column",
    "read_manifest",
    "read_trace",
    "sha256_of",
    "struct_column",
    "to_row",
    "verify",
    "write_trace",
    "writing",
]
