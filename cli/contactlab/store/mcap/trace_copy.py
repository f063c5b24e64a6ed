"""A trace file written again with channels added, as viewers need them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, Schema

from contactlab.store.mcap.chunk_writer import Times, overlapping
from contactlab.store.mcap.mcap_summary import FileHead, file_head, file_prefix
from contactlab.store.mcap.message_encoder import Items, MessageGroup, Rows, single_message_group
from contactlab.store.mcap.message_layout import HEADER_SIZE, MessageLayout, message_record
from contactlab.store.mcap.trace_reader import ChannelMessages, channel_messages
from contactlab.store.mcap.trace_schema import STATE_TOPIC
from contactlab.store.mcap.trace_writer import encode_messages


@dataclass(frozen=True)
class AddedChannel:
    """A channel of Protobuf messages to be added to a trace.

    Attributes:
        topic: its topic.
        schema_name: full name of the message type; channels of one type share its schema.
        descriptors: serialized FileDescriptorSet that defines the type.
        messages: (state row, serialized message), rows ascending, at most one message a row.
    """

    topic: str
    schema_name: str
    descriptors: bytes
    messages: Sequence[tuple[int, bytes]]


def copy_trace(source: Path, target: Path, added: Sequence[AddedChannel]) -> None:
    """Write a trace file again with further channels; its own messages keep their bytes.

    Args:
        source: a sound trace file.
        target: the file to make or replace.
        added: the channels to add, and their messages.

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
    times = _log_times(messages[state])
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


def _log_times(messages: ChannelMessages) -> Times:
    return messages.pick(slice(None), message_record(MessageLayout(b"")))["log_time"].copy()


def _copied(messages: Mapping[int, ChannelMessages], times: Times) -> Iterator[MessageGroup]:
    """Yield the source's messages, those of one channel and length together."""
    for channel, each in messages.items():
        rows = np.searchsorted(times, _log_times(each))
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
