"""Traces written straight into files, and what viewers rely on in them."""

import hashlib
import struct
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.reader import NonSeekingReader, SeekingReader
from mcap.records import Chunk, MessageIndex
from mcap.stream_reader import StreamReader

from contactlab.contact.trace_arrays import PairSeries, Trace
from contactlab.schema.vocabulary import TraceFormat
from contactlab.store.atomic_files import atomic_write
from contactlab.store.mcap.stored_messages import UNREADABLE, find_damage
from contactlab.store.mcap.trace_check import check_trace
from contactlab.store.mcap.trace_writer import TraceEncoder


class TraceExtras(NamedTuple):
    """What a trace's file holds beside the arrays."""

    record_json: bytes
    metadata: Mapping[str, str]
    model_xml: bytes


class Written(NamedTuple):
    """What a record says of a trace's file."""

    sha256: str
    size: int
    messages: Mapping[str, int]


def find_defect(file: bytes) -> str | None:
    """Return the defect of a file; None if C and NumPy find it valid, with the same content."""
    if damage := find_damage(file):
        return damage
    found = list[object]()
    with pytest.MonkeyPatch.context() as patch:
        for kernel in ("", "off"):
            patch.setenv("CONTACTLAB_KERNEL", kernel)
            try:
                found.append(check_trace(file))
            except UNREADABLE as error:
                found.append(f"{type(error).__name__}: {error}")
    assert isinstance(found[0], str) == isinstance(found[1], str), found
    if isinstance(found[0], str):
        return found[0]
    assert found[0] == found[1]
    return None


def write_trace(
    path: Path,
    trace: Trace,
    run: int,
    series: Sequence[PairSeries],
    extras: TraceExtras,
    form: TraceFormat = "messages",
) -> Written:
    """Write one run of a trace."""
    content, messages = TraceEncoder(trace, series).encode_run(run, *extras, form=form)
    with atomic_write(path) as temporary:
        temporary.write_bytes(content)
    return Written(hashlib.sha256(content).hexdigest(), len(content), messages)


def assert_viewable(path: Path) -> None:
    """Check by the mcap package that all messages are found in order of time, by every index."""
    with path.open("rb") as file:
        reader = NonSeekingReader(file, validate_crcs=True)
        streamed = list(reader.iter_messages(log_time_order=False))
    with path.open("rb") as file:
        reader = SeekingReader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert list(reader.iter_messages()) == streamed
    counts = Counter(channel.id for _, channel, _ in streamed)
    times = [message.log_time for _, _, message in streamed]
    assert summary is not None
    assert summary.statistics is not None
    assert Counter(summary.statistics.channel_message_counts) == counts == _indexed(path)
    assert summary.statistics.message_count == len(times)
    assert summary.statistics.message_start_time == min(times)
    assert summary.statistics.message_end_time == max(times)
    assert len(summary.chunk_indexes) == summary.statistics.chunk_count


def _indexed(path: Path) -> Counter[int]:
    """Return how many messages of each channel the message indexes point at."""
    found, content = Counter[int](), b""
    with path.open("rb") as file:
        for record in StreamReader(file, emit_chunks=True).records:
            if isinstance(record, Chunk):
                content = zstandard.decompress(record.data)
            elif isinstance(record, MessageIndex):
                for time, offset in record.records:
                    kind, _, channel, _, at = struct.unpack_from("<BQHIQ", content, offset)
                    assert (kind, channel, at) == (Opcode.MESSAGE, record.channel_id, time)
                    found[channel] += 1
    return found
