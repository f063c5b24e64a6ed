"""Traces in MCAP."""

from contactlab.store.mcap.check import check_trace
from contactlab.store.mcap.reader import read_trace
from contactlab.store.mcap.stored import StoredPair, StoredTrace
from contactlab.store.mcap.writer import TraceExtras, TraceSummary, write_trace

__all__ = [
    "StoredPair",
    "StoredTrace",
    "TraceExtras",
    "TraceSummary",
    "check_trace",
    "read_trace",
    "write_trace",
]
