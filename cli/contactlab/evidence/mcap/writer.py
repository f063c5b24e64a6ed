"""One run written as one MCAP file, by way of a temporary file in the same folder.

Log time is simulated time from zero and nothing of the machine is added, so equal runs give equal
files. Files are not synced to disk one by one; the store does that once, before it publishes.
"""

import hashlib
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.records import Attachment, Channel, ChunkIndex, Metadata, Schema

from contactlab.errors import OutputError
from contactlab.evidence.files import replacing
from contactlab.evidence.mcap.chunks import Stream, Times, chunk_records, interleave
from contactlab.evidence.mcap.container import Head, head, tail
from contactlab.evidence.mcap.descriptor import file_descriptor_set
from contactlab.evidence.mcap.encode import (
    STATE_CHANNEL,
    Group,
    blob_group,
    contact_groups,
    state_groups,
)
from contactlab.evidence.mcap.messages import CONTACTS, PACKAGE, STATE
from contactlab.evidence.mcap.topics import EVIDENCE_TOPIC, STATE_TOPIC, contacts_topic
from contactlab.trace import Floats, PairSeries, PairTrace, Trace

METADATA_NAME = "contactlab.run"
MODEL_NAME = "model.xml"

_NANOSECONDS = 1e9
# Readers in languages without unsigned integers take log time as a signed 64-bit number.
_LATEST = 2.0**63


@dataclass(frozen=True)
class TraceExtras:
    """What a trace file holds beside the arrays.

    Attributes:
        record_json: the EvidenceRecord, a JSON object; the one message of `/evidence`.
        record_schema: its JSON Schema. Viewers reject `$ref`, `anyOf` and null in it.
        metadata: the run's identity, as the metadata record `contactlab.run`.
        model_xml: the MJCF as simulated, as the attachment `model.xml`.
    """

    record_json: bytes
    record_schema: bytes
    metadata: Mapping[str, str]
    model_xml: bytes


@dataclass(frozen=True)
class TraceSummary:
    """What was written.

    Attributes:
        sha256: hash of the file, in hex.
        size: its length in bytes.
        messages: number of messages by topic.
    """

    sha256: str
    size: int
    messages: Mapping[str, int]


def write_trace(
    path: Path, trace: Trace, run: int, series: Sequence[PairSeries], extras: TraceExtras
) -> TraceSummary:
    """Write one run of a trace as an MCAP file.

    Args:
        path: the file; one that is there is replaced as a whole. Its folder must exist.
        trace: arrays of a group of runs.
        run: which of them to write.
        series: net quantities of the trace's pairs, in the same order.
        extras: the run's record, identity and model.

    Raises:
        OutputError: the file cannot be written, or the run's time does not strictly increase.
    """
    times = _log_times(path, trace.time[run])
    groups = list(_groups(trace, run, series, extras))
    return write_messages(path, _head(trace, extras), groups, times)


def write_messages(path: Path, start: Head, groups: Sequence[Group], times: Times) -> TraceSummary:
    """Write messages as an MCAP file.

    Args:
        path: the file; one that is there is replaced as a whole. Its folder must exist.
        start: the start of the file, with its channels.
        groups: the messages.
        times: (rows,) log time [ns].

    Raises:
        OutputError: the file cannot be written.
    """
    stream = interleave(groups, len(start.channels), times)
    counts = np.count_nonzero(stream.sizes, axis=0).tolist()
    digest, size = _save(path, _parts(start, stream, counts))
    topics = (channel.topic for channel in start.channels)
    return TraceSummary(digest, size, dict(zip(topics, counts, strict=True)))


def _log_times(path: Path, time: Floats) -> Times:
    """Return simulated time in whole nanoseconds."""
    times = np.rint(time * _NANOSECONDS)
    grows = np.all(times[1:] > times[:-1]) and np.all((times >= 0) & (times < _LATEST))
    if not grows:
        raise OutputError(
            f"cannot write {path}: the run's time must start at zero or later and grow by a "
            "nanosecond or more each step; cut the run where the engine stopped it"
        )
    return times.astype(np.uint64)


def _head(trace: Trace, extras: TraceExtras) -> Head:
    state, contacts, evidence = (
        Schema(1, file_descriptor_set(STATE), "protobuf", f"{PACKAGE}.{STATE.name}"),
        Schema(2, file_descriptor_set(CONTACTS), "protobuf", f"{PACKAGE}.{CONTACTS.name}"),
        Schema(3, extras.record_schema, "jsonschema", f"{PACKAGE}.EvidenceRecord"),
    )
    sizes = {"nq": str(trace.qpos.shape[2]), "nv": str(trace.qvel.shape[2])}
    channels = [Channel(1, STATE_TOPIC, "protobuf", sizes, state.id)]
    for number, pair in enumerate(trace.pairs, start=2):
        topic = contacts_topic(pair.name)
        channels.append(Channel(number, topic, "protobuf", {"pair": pair.name}, contacts.id))
    channels.append(Channel(len(channels) + 1, EVIDENCE_TOPIC, "json", {}, evidence.id))
    return head(
        [state, contacts, evidence],
        channels,
        Attachment(0, 0, MODEL_NAME, "application/xml", extras.model_xml),
        Metadata(METADATA_NAME, dict(extras.metadata)),
    )


def _groups(
    trace: Trace, run: int, series: Sequence[PairSeries], extras: TraceExtras
) -> Iterator[Group]:
    yield from state_groups(trace, run)
    timestep = float(trace.timestep[run])
    pairs: Iterator[tuple[PairTrace, PairSeries]] = zip(trace.pairs, series, strict=True)
    for channel, (pair, net) in enumerate(pairs, start=STATE_CHANNEL + 1):
        yield from contact_groups(channel, pair, net, run, timestep)
    yield blob_group(len(trace.pairs) + 2, trace.steps, extras.record_json)


def _parts(start: Head, stream: Stream, counts: Sequence[int]) -> Iterator[bytes]:
    """Yield the file's bytes: its start, the chunks with their indexes, its end."""
    yield start.data
    crc, position = zlib.crc32(start.data), len(start.data)
    entries: list[ChunkIndex] = []
    for parts, entry in chunk_records(stream, position):
        for part in parts:
            yield part
            crc, position = zlib.crc32(part, crc), position + len(part)
        entries.append(entry)
    yield tail(start, entries, dict(enumerate(counts, start=1)), position, crc)


def _save(path: Path, parts: Iterator[bytes]) -> tuple[str, int]:
    """Write a file as a whole; return its SHA-256 and size."""
    digest, size = hashlib.sha256(), 0
    with replacing(path) as temporary, temporary.open("wb") as file:
        for part in parts:
            file.write(part)
            digest.update(part)
            size += len(part)
    return digest.hexdigest(), size
