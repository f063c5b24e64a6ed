"""One run written as one MCAP file, by way of a temporary file in the same folder.

Log time is simulated time from zero and nothing of the machine is added, so equal runs give equal
files. Files are not synced to disk one by one; the store does that once, before it publishes.
"""

import hashlib
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from io import BytesIO
from pathlib import Path

import numpy as np
from mcap.records import Attachment, Channel, Schema

from contactlab.contact import Floats, PairSeries, PairTrace, Trace
from contactlab.errors import OutputError
from contactlab.store.atomic_files import atomic_write
from contactlab.store.mcap.chunk_writer import MessageStream, Times, chunk_records, interleave
from contactlab.store.mcap.mcap_summary import (
    ChunkEntry,
    FileHead,
    FilePrefix,
    file_head,
    file_prefix,
    file_tail,
)
from contactlab.store.mcap.message_encoder import (
    STATE_CHANNEL,
    MessageGroup,
    contact_groups,
    single_message_group,
    state_groups,
)
from contactlab.store.mcap.trace_schema import (
    CONTACTS,
    EVIDENCE_TOPIC,
    PACKAGE,
    STATE,
    STATE_TOPIC,
    contacts_topic,
    file_descriptor_set,
)

Target = Path | BytesIO
METADATA_NAME = "contactlab.run"
MODEL_NAME = "model.xml"

_NANOSECONDS = 1e9
# How many scenes' openings are kept; a job is of one.
_SCENES = 4
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
    path: Target, trace: Trace, run: int, series: Sequence[PairSeries], extras: TraceExtras
) -> TraceSummary:
    """Write one run of a trace as an MCAP file.

    Args:
        path: the file; one that is there is replaced as a whole. Its folder must exist. Or a
            buffer in memory.
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


def write_messages(
    path: Target, start: FileHead, groups: Sequence[MessageGroup], times: Times
) -> TraceSummary:
    """Write messages as an MCAP file.

    Args:
        path: the file; one that is there is replaced as a whole. Its folder must exist.
        start: the start of the file, with its channels.
        groups: the messages.
        times: (rows,) log time [ns].

    Raises:
        OutputError: the file cannot be written.
    """
    stream = interleave(groups, len(start.prefix.topics), times)
    counts = np.count_nonzero(stream.sizes, axis=0).tolist()
    digest, size = _save(path, _parts(start, stream, counts))
    return TraceSummary(digest, size, dict(zip(start.prefix.topics, counts, strict=True)))


def _log_times(path: Target, time: Floats) -> Times:
    """Return simulated time in whole nanoseconds."""
    times = np.rint(time * _NANOSECONDS)
    grows = np.all(times[1:] > times[:-1]) and np.all((times >= 0) & (times < _LATEST))
    if not grows:
        named = path if isinstance(path, Path) else "a trace"
        raise OutputError(
            f"cannot write {named}: the run's time must start at zero or later and grow by a "
            "nanosecond or more each step; cut the run where the engine stopped it"
        )
    return times.astype(np.uint64)


def _head(trace: Trace, extras: TraceExtras) -> FileHead:
    pairs = tuple(pair.name for pair in trace.pairs)
    sizes = trace.qpos.shape[2], trace.qvel.shape[2]
    start = _opening(pairs, sizes, extras.record_schema, extras.model_xml)
    return file_head(start, METADATA_NAME, extras.metadata)


@lru_cache(maxsize=_SCENES)
def _opening(
    pairs: tuple[str, ...], sizes: tuple[int, int], record_schema: bytes, model_xml: bytes
) -> FilePrefix:
    state, contacts, evidence = (
        Schema(1, file_descriptor_set(STATE), "protobuf", f"{PACKAGE}.{STATE.name}"),
        Schema(2, file_descriptor_set(CONTACTS), "protobuf", f"{PACKAGE}.{CONTACTS.name}"),
        Schema(3, record_schema, "jsonschema", f"{PACKAGE}.EvidenceRecord"),
    )
    nq, nv = map(str, sizes)
    channels = [Channel(1, STATE_TOPIC, "protobuf", {"nq": nq, "nv": nv}, state.id)]
    for number, name in enumerate(pairs, start=2):
        topic = contacts_topic(name)
        channels.append(Channel(number, topic, "protobuf", {"pair": name}, contacts.id))
    channels.append(Channel(len(channels) + 1, EVIDENCE_TOPIC, "json", {}, evidence.id))
    model = Attachment(0, 0, MODEL_NAME, "application/xml", model_xml)
    return file_prefix([state, contacts, evidence], channels, model)


def _groups(
    trace: Trace, run: int, series: Sequence[PairSeries], extras: TraceExtras
) -> Iterator[MessageGroup]:
    yield from state_groups(trace, run)
    timestep = float(trace.timestep[run])
    pairs: Iterator[tuple[PairTrace, PairSeries]] = zip(trace.pairs, series, strict=True)
    for channel, (pair, net) in enumerate(pairs, start=STATE_CHANNEL + 1):
        yield from contact_groups(channel, pair, net, run, timestep)
    yield single_message_group(len(trace.pairs) + 2, trace.steps, extras.record_json)


def _parts(start: FileHead, stream: MessageStream, counts: Sequence[int]) -> Iterator[bytes]:
    """Yield the file's bytes: its start, the chunks with their indexes, its end."""
    data = start.data
    yield data
    crc, position = start.crc, len(data)
    entries: list[ChunkEntry] = []
    for parts, entry in chunk_records(stream, position):
        for part in parts:
            yield part
            crc, position = zlib.crc32(part, crc), position + len(part)
        entries.append(entry)
    yield file_tail(start, entries, counts, crc)


def _save(path: Target, parts: Iterator[bytes]) -> tuple[str, int]:
    """Write a file as a whole; return its SHA-256 and size."""
    content = b"".join(parts)
    if isinstance(path, BytesIO):
        path.write(content)
    else:
        with atomic_write(path) as temporary, temporary.open("wb") as file:
            file.write(content)
    return hashlib.sha256(content).hexdigest(), len(content)
