"""Traces written straight into files."""

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from contactlab.contact.trace_arrays import PairSeries, Trace
from contactlab.store.atomic_files import atomic_write
from contactlab.store.mcap.trace_writer import TraceExtras, encode_trace


class Written(NamedTuple):
    """What a record says of a trace's file."""

    sha256: str
    size: int
    messages: Mapping[str, int]


def write_trace(
    path: Path, trace: Trace, run: int, series: Sequence[PairSeries], extras: TraceExtras
) -> Written:
    """Write one run of a trace."""
    content, messages = encode_trace(trace, run, series, extras)
    with atomic_write(path) as temporary:
        temporary.write_bytes(content)
    return Written(hashlib.sha256(content).hexdigest(), len(content), messages)
