"""Encodes one run as one MCAP file, and adds channels to a file.

Log time is simulated time from zero, and nothing machine-dependent is added, so equal runs give
equal files.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from io import BytesIO
from operator import itemgetter
from pathlib import Path

import numpy as np
from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, Schema
from mcap.writer import Writer
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats, PairSeries, Trace
from contactlab.disk_arrays import disk_memory_in_use
from contactlab.errors import OutputError
from contactlab.schema.vocabulary import TraceFormat
from contactlab.store.atomic_files import atomic_write
from contactlab.store.mcap.compact_blocks import BLOCKS, compact_records, expand_file
from contactlab.store.mcap.file_parts import (
    LIBRARY,
    FileStart,
    encode_file,
    encode_long_file,
    file_start,
    interleave_groups,
    with_metadata,
)
from contactlab.store.mcap.message_encoder import (
    STATE_CHANNEL,
    Times,
    TraceColumns,
    message_group,
    single_message,
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
# Viewers reject `$ref`, `anyOf` and null in a schema, which the record's has.
RECORD_SCHEMA_NAME = f"{PACKAGE}.EvidenceRecord"
_RECORD_SCHEMA = b'{"type":"object"}'


class TraceEncoder:
    """Encodes the runs of a trace, each as an MCAP file; common parts are computed once."""

    def __init__(self, trace: Trace, series: Sequence[PairSeries]) -> None:
        """Take a trace, and the net quantities of at least those of its pairs that touch."""
        self._trace = trace
        self._times, self._in_order = _log_times(trace.time)
        self._pairs = tuple(pair.name for pair in trace.pairs)
        channels = {name: channel for channel, name in enumerate(self._pairs, STATE_CHANNEL + 1)}
        net_of_channel = {channels[net.name]: net for net in series if net.contacts.any()}
        touching = {
            channel: (trace.pairs[channel - STATE_CHANNEL - 1], net_of_channel[channel])
            for channel in sorted(net_of_channel)
        }
        self._columns = TraceColumns(trace, self._times, touching)

    def encode_run(
        self,
        run: int,
        record_json: bytes,
        metadata: Mapping[str, str],
        model_xml: bytes,
        *,
        form: TraceFormat = "messages",
    ) -> tuple[bytes, Mapping[str, int]]:
        """Return a run as an MCAP file, and the number of its messages by topic.

        In the compact form blocks replace the messages, which are counted as in the other form. The
        file contains the arrays; the run's record, the one message of `/evidence`; its identity,
        the metadata `contactlab.run`; and the simulated MJCF, the attachment `model.xml`. An
        OutputError says that the run's time does not strictly increase.
        """
        trace, times = self._trace, self._times[run]
        if not self._in_order[run]:
            raise OutputError(
                "cannot write a trace: the run's time must not be negative and must grow by at "
                "least a nanosecond each step; cut the run where the engine stopped it"
            )
        sizes = trace.qpos.shape[2], trace.qvel.shape[2]
        encoding = BLOCKS if form == "compact" else PROTOBUF
        start = _scene_start(self._pairs, sizes, model_xml, encoding)
        start = with_metadata(start, _METADATA_NAME, metadata)
        timestep = trace.timestep[run].item()
        records = [
            *self._columns.state_records(run),
            *self._columns.contact_records(run),
        ]
        channels = len(start.topics)
        each = np.concatenate([record.channels for record in records]) - 1
        counts = dict(
            zip(start.topics, np.bincount(each, minlength=channels).tolist(), strict=True)
        )
        counts[EVIDENCE_TOPIC] = 1
        if form == "compact":
            groups, begins = compact_records(records, times, timestep)
        else:
            groups, begins = [*map(message_group, records)], times
        last = len(begins) - 1
        groups.append(single_message(channels, last, int(begins[last]), record_json))
        stream = interleave_groups(groups, channels, begins)
        if disk_memory_in_use():
            return encode_long_file(start, stream), counts
        return encode_file(start, stream), counts


def _log_times(time: Floats) -> tuple[Times, NDArray[np.bool_]]:
    """Return (n, N + 1) simulated time in whole nanoseconds, and whether each run's is valid."""
    times = np.rint(time * 1e9)
    grows = np.all(times[:, 1:] > times[:, :-1], axis=1)
    # Since times increase, checking both ends covers the range of all.
    # Readers in languages without unsigned integers take log time as a signed 64-bit number.
    grows &= (times[:, 0] >= 0) & (times[:, -1] < 2.0**63)
    with np.errstate(invalid="ignore"):
        return times.astype(np.uint64), grows


# Scenes with cached file prefixes; a job is of one scene.
@lru_cache(maxsize=4)
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
    """Write a valid trace file again with further channels; its own messages keep their bytes.

    A file in the compact form becomes one of messages; `schemas` by name replace its own.
    """
    reader = SeekingReader(BytesIO(expand_file(source.read_bytes())))
    summary = reader.get_summary()
    assert summary is not None, "a sound file has a summary"
    stored = [(channel, message) for _, channel, message in reader.iter_messages()]
    times = [message.log_time for channel, message in stored if channel.topic == STATE_TOPIC]
    messages = [(message.log_time, channel.id, message.data) for channel, message in stored]
    with atomic_write(target) as temporary, temporary.open("wb") as file:
        writer = Writer(file, enable_data_crcs=True)
        writer.start(library=LIBRARY)
        for attachment in reader.iter_attachments():
            writer.add_attachment(0, 0, attachment.name, attachment.media_type, attachment.data)
        for metadata in reader.iter_metadata():
            writer.add_metadata(metadata.name, metadata.metadata)
        for schema in summary.schemas.values():
            data = schemas.get(schema.name, schema.data)
            writer.register_schema(schema.name, schema.encoding, data)
        for old_channel in summary.channels.values():
            writer.register_channel(
                old_channel.topic,
                old_channel.message_encoding,
                old_channel.schema_id,
                old_channel.metadata,
            )
        types = {
            name: writer.register_schema(name, "protobuf", definition)
            for name, definition in {
                series.schema_name: series.descriptors for series in added
            }.items()
        }
        for series in added:
            channel = writer.register_channel(series.topic, "protobuf", types[series.schema_name])
            messages += [(times[row], channel, data) for row, data in series.messages]
        for time, channel, data in sorted(messages, key=itemgetter(0, 1)):
            writer.add_message(channel, time, data, time)
        writer.finish()
