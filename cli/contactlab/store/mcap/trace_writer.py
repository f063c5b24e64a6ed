"""One run encoded as one MCAP file.

Log time is simulated time from zero and nothing of the machine is added, so equal runs give equal
files.
"""

import hashlib
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from mcap.records import Attachment, Channel, ChunkIndex, Schema

from contactlab.contact import Floats, PairSeries, PairTrace, Trace
from contactlab.errors import OutputError
from contactlab.store.atomic_files import atomic_write
from contactlab.store.mcap.chunk_writer import MessageStream, Times, chunk_records, interleave
from contactlab.store.mcap.mcap_summary import (
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

_METADATA_NAME = "contactlab.run"
_MODEL_NAME = "model.xml"
_NANOSECONDS = 1e9
_CACHED_PREFIXES = 4
"""Scenes whose file prefixes are cached; a job is of one scene."""
# Readers in languages without unsigned integers take log time as a signed 64-bit number.
_MAX_LOG_TIME = 2.0**63


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
class EncodedTrace:
    """A trace file in memory.

    Attributes:
        content: its bytes.
        messages: number of messages by topic.
    """

    content: bytes
    messages: Mapping[str, int]

    @property
    def sha256(self) -> str:
        """SHA-256 of the file, in hex."""
        return hashlib.sha256(self.content).hexdigest()

    @property
    def size(self) -> int:
        """Its length in bytes."""
        return len(self.content)

    def write(self, path: Path) -> None:
        """Create or replace a file; its folder must exist.

        Raises:
            OutputError: it cannot be written.
        """
        with atomic_write(path) as temporary:
            temporary.write_bytes(self.content)


def encode_trace(
    trace: Trace, run: int, series: Sequence[PairSeries], extras: TraceExtras
) -> EncodedTrace:
    """Return one run of a trace as an MCAP file.

    Args:
        trace: arrays of a group of runs.
        run: index of the run in the group.
        series: net quantities of the trace's pairs, in the same order.
        extras: the run's record, identity and model.

    Raises:
        OutputError: the run's time does not strictly increase.
    """
    times = _log_times(trace.time[run])
    return encode_messages(_head(trace, extras), list(_groups(trace, run, series, extras)), times)


def write_trace(
    path: Path, trace: Trace, run: int, series: Sequence[PairSeries], extras: TraceExtras
) -> EncodedTrace:
    """Write one run of a trace into a file; see `encode_trace`."""
    encoded = encode_trace(trace, run, series, extras)
    encoded.write(path)
    return encoded


def encode_messages(head: FileHead, groups: Sequence[MessageGroup], times: Times) -> EncodedTrace:
    """Return messages as an MCAP file.

    Args:
        head: the start of the file, with its channels.
        groups: the messages.
        times: (rows,) log time [ns].
    """
    topics = head.prefix.topics
    stream = interleave(groups, len(topics), times)
    counts = np.count_nonzero(stream.sizes, axis=0).tolist()
    content = b"".join(_parts(head, stream, counts))
    return EncodedTrace(content, dict(zip(topics, counts, strict=True)))


def _log_times(time: Floats) -> Times:
    """Return simulated time in whole nanoseconds."""
    times = np.rint(time * _NANOSECONDS)
    in_range = np.all((times >= 0) & (times < _MAX_LOG_TIME))
    if not (in_range and np.all(times[1:] > times[:-1])):
        raise OutputError(
            "cannot write a trace: the run's time must start at zero or later and grow by a "
            "nanosecond or more each step; cut the run where the engine stopped it"
        )
    return times.astype(np.uint64)


def _head(trace: Trace, extras: TraceExtras) -> FileHead:
    pairs = tuple(pair.name for pair in trace.pairs)
    sizes = trace.qpos.shape[2], trace.qvel.shape[2]
    prefix = _prefix(pairs, sizes, extras.record_schema, extras.model_xml)
    return file_head(prefix, _METADATA_NAME, extras.metadata)


@lru_cache(maxsize=_CACHED_PREFIXES)
def _prefix(
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
    model = Attachment(0, 0, _MODEL_NAME, "application/xml", model_xml)
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


def _parts(head: FileHead, stream: MessageStream, counts: Sequence[int]) -> Iterator[bytes]:
    """Yield the file's bytes: its start, the chunks with their indexes, its end."""
    data = head.data
    yield data
    crc = head.crc
    chunks: list[ChunkIndex] = []
    for parts, chunk in chunk_records(stream, len(data)):
        for part in parts:
            yield part
            crc = zlib.crc32(part, crc)
        chunks.append(chunk)
    yield file_tail(head, chunks, counts, crc)
