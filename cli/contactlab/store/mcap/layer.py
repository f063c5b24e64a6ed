"""A stored trace file with what 3D viewers need beside it: poses, shapes, contact arrows."""

from collections.abc import Iterator, Mapping
from io import BytesIO
from pathlib import Path

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.message import Message
from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, Schema

from contactlab.contact import BodyMotion
from contactlab.store.mcap.chunks import Times, overlapping
from contactlab.store.mcap.container import Head, head, opening
from contactlab.store.mcap.decode import Messages
from contactlab.store.mcap.encode import Group, Items, Rows, blob_group
from contactlab.store.mcap.foxglove import contact_forces, descriptors, scene, transforms
from contactlab.store.mcap.layout import HEADER_SIZE, Layout, record
from contactlab.store.mcap.reader import channel_messages
from contactlab.store.mcap.topics import (
    FORCES_TOPIC,
    SCENE_TOPIC,
    STATE_TOPIC,
    TRANSFORMS_TOPIC,
)
from contactlab.store.mcap.writer import TraceSummary, write_messages

_LAYER = {
    SCENE_TOPIC: SceneUpdate,
    TRANSFORMS_TOPIC: FrameTransforms,
    FORCES_TOPIC: SceneUpdate,
}


def write_with_layer(source: Path, target: Path, motion: BodyMotion) -> TraceSummary:
    """Write a trace file once more, message by message, with the 3D layer between.

    Args:
        source: a sound trace file of ours.
        target: the file to make or replace.
        motion: what is drawn of its run.

    Raises:
        OutputError: the file cannot be written.
    """
    data = source.read_bytes()
    reader = SeekingReader(BytesIO(data))
    summary = reader.get_summary()
    assert summary is not None, "a sound file has a summary"
    messages = channel_messages(data, summary)
    [state] = [each.id for each in summary.channels.values() if each.topic == STATE_TOPIC]
    times = _log_times(messages[state])
    start = _head(reader, list(summary.schemas.values()), list(summary.channels.values()))
    channels = {topic: number for number, topic in enumerate(start.opening.topics, start=1)}
    groups = [*_copied(messages, times), *_layer(motion, channels)]
    return write_messages(target, start, groups, times)


def _head(reader: SeekingReader, schemas: list[Schema], channels: list[Channel]) -> Head:
    """Return the start of the source with the layer's schemas and channels added."""
    numbers: dict[type[Message], int] = {}
    for message in dict.fromkeys(_LAYER.values()):
        numbers[message] = len(schemas) + 1
        name = message.DESCRIPTOR.full_name
        schemas.append(Schema(numbers[message], descriptors(message), "protobuf", name))
    for topic, message in _LAYER.items():
        channels.append(Channel(len(channels) + 1, topic, "protobuf", {}, numbers[message]))
    [attachment], [metadata] = reader.iter_attachments(), reader.iter_metadata()
    assert isinstance(attachment, Attachment)
    start = opening(schemas, channels, attachment)
    return head(start, metadata.name, metadata.metadata)


def _log_times(messages: Messages) -> Times:
    return messages.pick(slice(None), record(Layout(b"")))["log_time"].copy()


def _copied(messages: Mapping[int, Messages], times: Times) -> Iterator[Group]:
    """Yield the source's messages, those of one channel and length together."""
    for channel, each in messages.items():
        rows = np.searchsorted(times, _log_times(each))
        sizes = each.sizes
        for size in np.unique(sizes).tolist():
            chosen = sizes == size
            records = overlapping(each.data, size)[each.offsets[chosen]]
            yield _as_it_was(channel, rows[chosen], records)


def _as_it_was(channel: int, rows: Rows, records: Items) -> Group:
    size = records.dtype.itemsize

    def fill(items: Items) -> None:
        items.view(records.dtype)[:] = records

    return Group(channel, rows, record(Layout(bytes(size - HEADER_SIZE))), fill)


def _layer(motion: BodyMotion, channels: Mapping[str, int]) -> Iterator[Group]:
    yield _message(channels[SCENE_TOPIC], int(motion.rows[0]), scene(motion))
    for frame, row in enumerate(motion.rows.tolist()):
        yield _message(channels[TRANSFORMS_TOPIC], row, transforms(motion, frame))
        yield _message(channels[FORCES_TOPIC], row, contact_forces(motion, frame))


def _message(channel: int, row: int, message: Message) -> Group:
    return blob_group(channel, row, message.SerializeToString(deterministic=True))
