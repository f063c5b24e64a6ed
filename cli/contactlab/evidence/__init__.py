"""The store: traces in MCAP, one table in Parquet, a manifest written last."""

from contactlab.evidence.address import (
    SCHEMES,
    Address,
    ObjectAddress,
    absolute,
    located,
)
from contactlab.evidence.arrays import Measured, Numbers, RunColumns, Words
from contactlab.evidence.baseline import write_baseline
from contactlab.evidence.columns import (
    RESERVED,
    Column,
    axis_column,
    metric_column,
    ratios,
    struct_column,
)
from contactlab.evidence.files import TEMPORARY, cannot_write, replacing, sha256_of
from contactlab.evidence.identity import read_manifest
from contactlab.evidence.mcap import (
    StoredPair,
    StoredTrace,
    TraceExtras,
    TraceSummary,
    check_trace,
    read_trace,
    write_trace,
)
from contactlab.evidence.objects import local_scene
from contactlab.evidence.rows import SHARED, from_row, to_row
from contactlab.evidence.store import Store, open  # noqa: A004 - read as evidence.open
from contactlab.evidence.traces import TraceFolder
from contactlab.evidence.verify import verify
from contactlab.evidence.viewing import export_mcap, export_rrd
from contactlab.evidence.writer import SCENES, TRACES, StoreWriter, writing

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
    "StoredPair",
    "StoredTrace",
    "TraceExtras",
    "TraceFolder",
    "TraceSummary",
    "Words",
    "absolute",
    "axis_column",
    "cannot_write",
    "check_trace",
    "export_mcap",
    "export_rrd",
    "from_row",
    "local_scene",
    "located",
    "metric_column",
    "open",
    "ratios",
    "read_manifest",
    "read_trace",
    "replacing",
    "sha256_of",
    "struct_column",
    "to_row",
    "verify",
    "write_baseline",
    "write_trace",
    "writing",
]
