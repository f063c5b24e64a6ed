"""Encode one run as one MCAP file, and add channels to a file.

Log time is simulated time from zero and nothing of the machine is added, so equal runs give equal
files.
"""

import hashlib
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from io import BytesIO
from pathlib import Path

import numpy as np
from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, ChunkIndex, Schema

from contactlab.contact.trace_arrays import Floats, PairSeries, PairTrace, Trace
from contactlab.errors import OutputError
from contactlab.store.atomic_files import atomic_write
from contactlab.store.mcap.file_parts import (
    FileHead,
    FilePrefix,
    MessageStream,
    Times,
    chunk_records,
    file_head,
    file_prefix,
    file_tail,
    interleave,
    overlapping,
)
from contactlab.store.mcap.message_encoder import (
    STATE_CHANNEL,
    Items,
    MessageGroup,
    Rows,
    contact_groups,
    single_message_group,
    state_groups,
)
from contactlab.store.mcap.trace_messages import (
    CONTACTS,
    EVIDENCE_TOPIC,
    HEADER_SIZE,
    PACKAGE,
    STATE,
    STATE_TOPIC,
    MessageLayout,
    contacts_topic,
    file_descriptor_set,
    message_record,
)
from contactlab.store.mcap.trace_reader import ChannelMessages, channel_messages

_METADATA_NAME = "contactlab.run"
_MODEL_NAME = "model.xml"
_NANOSECONDS = 1e9
_CACHED_PREFIXES = 4
"""Scenes whose file prefixes are cached; a job is of one scene."""
# Readers in languages without unsigned integers take log time as a signed 64-bit number.
_MAX_LOG_TIME = 2.0**63


@dataclass(frozen=True)
class TraceExtras:
    """Content of a trace file in addition to the arrays.

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
    """A trace file in memory, and the number of its messages by topic."""

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
    """Return messages as an MCAP file; log times (rows,) are in ns."""
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
            "cannot write a trace: the run's time must not be negative and must grow by at least "
            "a nanosecond each step; cut the run where the engine stopped it"
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


@dataclass(frozen=True)
class AddedChannel:
    """A channel of Protobuf messages to be added to a trace.

    Attributes:
        schema_name: full name of the message type; channels of one type share its schema.
        descriptors: serialized FileDescriptorSet that defines the type.
        messages: (state row, serialized message), rows ascending, at most one message a row.
    """

    topic: str
    schema_name: str
    descriptors: bytes
    messages: Sequence[tuple[int, bytes]]


def copy_trace(source: Path, target: Path, added: Sequence[AddedChannel]) -> None:
    """Write a sound trace file again with further channels; its own messages keep their bytes.

    Raises:
        OutputError: the file cannot be written.
    """
    data = source.read_bytes()
    reader = SeekingReader(BytesIO(data))
    summary = reader.get_summary()
    assert summary is not None, "a sound file has a summary"
    messages = channel_messages(data, summary)
    channels = list(summary.channels.values())
    [state] = [each.id for each in channels if each.topic == STATE_TOPIC]
    times = _stored_times(messages[state])
    head = _file_head(reader, list(summary.schemas.values()), channels, added)
    groups = [*_copied(messages, times), *_added(added, len(channels) + 1)]
    encode_messages(head, groups, times).write(target)


def _file_head(
    reader: SeekingReader,
    schemas: Sequence[Schema],
    channels: Sequence[Channel],
    added: Sequence[AddedChannel],
) -> FileHead:
    """Return the start of the source with the added schemas and channels."""
    types = {each.schema_name: each.descriptors for each in added}
    more_schemas = [
        Schema(number, definition, "protobuf", name)
        for number, (name, definition) in enumerate(types.items(), start=len(schemas) + 1)
    ]
    ids = {schema.name: schema.id for schema in more_schemas}
    more_channels = [
        Channel(number, each.topic, "protobuf", {}, ids[each.schema_name])
        for number, each in enumerate(added, start=len(channels) + 1)
    ]
    [attachment], [metadata] = reader.iter_attachments(), reader.iter_metadata()
    assert isinstance(attachment, Attachment)
    prefix = file_prefix([*schemas, *more_schemas], [*channels, *more_channels], attachment)
    return file_head(prefix, metadata.name, metadata.metadata)


def _stored_times(messages: ChannelMessages) -> Times:
    return messages.pick(slice(None), message_record(MessageLayout(b"")))["log_time"].copy()


def _copied(messages: Mapping[int, ChannelMessages], times: Times) -> Iterator[MessageGroup]:
    """Yield the source's messages, those of one channel and length together."""
    for channel, each in messages.items():
        rows = np.searchsorted(times, _stored_times(each))
        sizes = each.sizes
        for size in np.unique(sizes).tolist():
            chosen = sizes == size
            records = overlapping(each.data, size)[each.offsets[chosen]]
            yield _unchanged(channel, rows[chosen], records)


def _unchanged(channel: int, rows: Rows, records: Items) -> MessageGroup:
    size = records.dtype.itemsize

    def fill(items: Items) -> None:
        items.view(records.dtype)[:] = records

    layout = message_record(MessageLayout(bytes(size - HEADER_SIZE)))
    return MessageGroup(channel, rows, layout, fill)


def _added(added: Sequence[AddedChannel], first: int) -> Iterator[MessageGroup]:
    for channel, each in enumerate(added, start=first):
        for row, content in each.messages:
            yield single_message_group(channel, row, content)
