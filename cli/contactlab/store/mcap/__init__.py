"""Traces in MCAP."""

from contactlab.store.mcap.mcap_check import check_trace
from contactlab.store.mcap.stored_trace import StoredPair, StoredTrace
from contactlab.store.mcap.trace_reader import read_trace
from contactlab.store.mcap.trace_writer import (
    AddedChannel,
    EncodedTrace,
    TraceExtras,
    copy_trace,
    encode_trace,
    write_trace,
)

__all__ = [
    "AddedChannel",
    "EncodedTrace",
    "StoredPair",
    "StoredTrace",
    "TraceExtras",
    "check_trace",
    "copy_trace",
    "encode_trace",
    "read_trace",
    "write_trace",
]
