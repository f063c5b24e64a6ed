"""Traces as MCAP files: one run a file, written by NumPy, readable by every MCAP viewer."""

from contactlab.evidence.mcap.check import check_trace
from contactlab.evidence.mcap.reader import read_trace
from contactlab.evidence.mcap.stored import StoredPair, StoredTrace
from contactlab.evidence.mcap.writer import TraceExtras, TraceSummary, write_trace

__all__ = [
    "StoredPair",
    "StoredTrace",
    "TraceExtras",
    "TraceSummary",
    "check_trace",
    "read_trace",
    "write_trace",
]
