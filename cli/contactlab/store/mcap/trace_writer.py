"""Encode one run as one MCAP file, and add channels to a file.

Log time is simulated time from zero and nothing of the machine is added, so equal runs give equal
files.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from io import BytesIO
from operator import itemgetter
from pathlib import Path

import numpy as np
from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, Schema
from mcap.writer import Writer

from contactlab.contact.trace_arrays import Floats, PairSeries, Trace
from contactlab.errors import OutputError
from contactlab.schema.vocabulary import TraceFormat
from contactlab.store.atomic_files import atomic_write
from contactlab.store.mcap.compact_blocks import BLOCKS, compacted, expanded
from contactlab.store.mcap.file_parts import (
    LIBRARY,
    FileStart,
    Times,
    encode_file,
    file_start,
    interleave,
    with_metadata,
)
from contactlab.store.mcap.message_encoder import (
    STATE_CHANNEL,
    MessageGroup,
    contact_groups,
    single_message,
    state_groups,
)
from contactlab.store.mcap.trace_messages import (
    CONTACTS,
    EVIDENCE_TOPIC,
    PACKAGE,
    PROTOBUF,
    STATE,
    STATE_TOPIC,
    contacts_topic,
    file_descriptor_set,
)

_METADATA_NAME = "contactlab.run"
_MODEL_NAME = "model.xml"
# Viewers reject `$ref`, `anyOf` and null in a schema, and the record has them.
RECORD_SCHEMA_NAME = f"{PACKAGE}.EvidenceRecord"
_RECORD_SCHEMA = b'{"type":"object"}'
_NANOSECONDS = 1e9
_CACHED_PREFIXES = 4  # scenes whose file prefixes are cached; a job is of one scene
# Readers in languages without unsigned integers take log time as a signed 64-bit number.
_MAX_LOG_TIME = 2.0**63


def encode_trace(  # noqa: PLR0913 - one argument a part of the file
    trace: Trace,
    run: int,
    series: Sequence[PairSeries],
    record_json: bytes,
    metadata: Mapping[str, str],
    model_xml: bytes,
    *,
    form: TraceFormat = "messages",
) -> tuple[bytes, Mapping[str, int]]:
    """Return one run of a trace as an MCAP file, and the number of its messages by topic.

    In the compact form blocks stand for the messages, which are counted as in the other form.

    The series are the net quantities of the trace's pairs, in the same order. With them go the
    run's record, the one message of `/evidence`; its identity, the metadata `contactlab.run`; and
    the MJCF as simulated, the attachment `model.xml`. An OutputError says that the run's time does
    not strictly increase.
    """
    times = _log_times(trace.time[run])
    pairs = tuple(pair.name for pair in trace.pairs)
    sizes = trace.qpos.shape[2], trace.qvel.shape[2]
    encoding = BLOCKS if form == "compact" else PROTOBUF
    start = _scene_start(pairs, sizes, model_xml, encoding)
    start = with_metadata(start, _METADATA_NAME, metadata)
    groups = [*_groups(trace, run, series)]
    counts = dict.fromkeys(start.topics, 0) | {EVIDENCE_TOPIC: 1}
    for group in groups:
        counts[start.topics[group.channel - 1]] += len(group.rows)
    if form == "compact":
        groups, times = compacted(groups, times, float(trace.timestep[run]))
    groups.append(single_message(len(start.topics), len(times) - 1, record_json))
    return encode_file(start, interleave(groups, len(start.topics), times)), counts


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


@lru_cache(maxsize=_CACHED_PREFIXES)
def _scene_start(
    pairs: tuple[str, ...], sizes: tuple[int, int], model_xml: bytes, encoding: str
) -> FileStart:
    state, contacts, evidence = (
        Schema(1, file_descriptor_set(STATE), PROTOBUF, f"{PACKAGE}.{STATE.name}"),
        Schema(2, file_descriptor_set(CONTACTS), PROTOBUF, f"{PACKAGE}.{CONTACTS.name}"),
        Schema(3, _RECORD_SCHEMA, "jsonschema", RECORD_SCHEMA_NAME),
    )
    nq, nv = map(str, sizes)
    channels = [Channel(1, STATE_TOPIC, encoding, {"nq": nq, "nv": nv}, state.id)]
    for number, name in enumerate(pairs, start=2):
        topic = contacts_topic(name)
        channels.append(Channel(number, topic, encoding, {"pair": name}, contacts.id))
    channels.append(Channel(len(channels) + 1, EVIDENCE_TOPIC, "json", {}, evidence.id))
    model = Attachment(0, 0, _MODEL_NAME, "application/xml", model_xml)
    return file_start([state, contacts, evidence], channels, model)


def _groups(trace: Trace, run: int, series: Sequence[PairSeries]) -> Iterator[MessageGroup]:
    yield from state_groups(trace, run)
    timestep = float(trace.timestep[run])
    for channel, (pair, net) in enumerate(zip(trace.pairs, series, strict=True), STATE_CHANNEL + 1):
        yield from contact_groups(channel, pair, net, run, timestep)


@dataclass(frozen=True)
class AddedChannel:
    """A channel of Protobuf messages to be added to a trace."""

    topic: str
    schema_name: str  # full name of the message type; channels of one type share its schema
    descriptors: bytes  # serialized FileDescriptorSet that defines the type
    messages: Sequence[tuple[int, bytes]]  # (state row, serialized message), rows ascending


def copy_trace(
    source: Path,
    target: Path,
    added: Sequence[AddedChannel],
    schemas: Mapping[str, bytes],
) -> None:
    """Write a sound trace file again with further channels; its own messages keep their bytes.

    One in the compact form becomes one of messages; schemas by name take the place of its own.
    """
    reader = SeekingReader(BytesIO(expanded(source.read_bytes())))
    summary = reader.get_summary()
    assert summary is not None, "a sound file has a summary"
    stored = [(channel, each) for _, channel, each in reader.iter_messages()]
    times = [each.log_time for channel, each in stored if channel.topic == STATE_TOPIC]
    messages = [(each.log_time, channel.id, each.data) for channel, each in stored]
    with atomic_write(target) as temporary, temporary.open("wb") as file:
        writer = Writer(file, enable_data_crcs=True)
        writer.start(library=LIBRARY)
        for each in reader.iter_attachments():
            writer.add_attachment(0, 0, each.name, each.media_type, each.data)
        for each in reader.iter_metadata():
            writer.add_metadata(each.name, each.metadata)
        for each in summary.schemas.values():
            data = schemas.get(each.name, each.data)
            writer.register_schema(each.name, each.encoding, data)
        for each in summary.channels.values():
            writer.register_channel(
                each.topic, each.message_encoding, each.schema_id, each.metadata
            )
        types = {
            name: writer.register_schema(name, "protobuf", definition)
            for name, definition in {each.schema_name: each.descriptors for each in added}.items()
        }
        for each in added:
            channel = writer.register_channel(each.topic, "protobuf", types[each.schema_name])
            messages += [(times[row], channel, data) for row, data in each.messages]
        for time, channel, data in sorted(messages, key=itemgetter(0, 1)):
            writer.add_message(channel, time, data, time)
        writer.finish()
