"""The compact form of a trace: its messages column by column, in blocks.

A block holds the messages of one channel in a stretch of time, grouped by their length, each group
as a head and the values of its messages. Values of one width lie together, as their second
differences from message to message: integers of that width that wrap around, signs folded in
(zigzag), first the lowest byte of all values, column by column, then the next byte. Values that
follow from others are omitted. Nothing is lost: blocks reproduce every message byte for byte.
"""

import struct
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from mcap.records import Channel

from contactlab.store.mcap.encode_buffers import SCRATCH
from contactlab.store.mcap.file_parts import encode_file, interleave_groups
from contactlab.store.mcap.message_encoder import (
    MessageGroup,
    Times,
    derived_fields,
    single_message,
)
from contactlab.store.mcap.record_encoder import (
    Bytes,
    Integers,
    Items,
    Records,
    overlapping_view,
    pack_values,
    unpack_values,
    write_records,
)
from contactlab.store.mcap.stored_messages import (
    ChannelMessages,
    StoredFile,
    file_start_of,
    message_stream,
    stored_file,
)
from contactlab.store.mcap.trace_messages import (
    PROTOBUF,
    STATE_TOPIC,
    MessageLayout,
    contacts_record,
    last_state_record,
    message_head,
    point_counts,
    state_record,
)

BLOCKS = "contactlab.blocks"
"""The message encoding of channels with blocks as messages."""
BLOCK_SIZE = 8 << 20
"""Bytes of messages in the blocks of one stretch of time, up to the addition of one step."""
_GROUP_HEAD = struct.Struct(
    "<IId"
)  # messages of a group, length of each, and the run's timestep [s]


def compact_records(
    records: Sequence[Records], times: Times, timestep: float
) -> tuple[list[MessageGroup], Times]:
    """Return the messages of (N + 1,) times as blocks, and the (B,) start times of these."""
    sizes = np.zeros(len(times), np.int64)
    for record in records:
        sizes += np.bincount(record.rows, minlength=len(times)) * record.layout.size
    starts = np.flatnonzero(np.diff(np.cumsum(sizes) // BLOCK_SIZE, prepend=-1))
    parts: dict[tuple[int, int], list[Records]] = defaultdict(list)
    for record in records:
        blocks = np.searchsorted(starts, record.rows, side="right") - 1
        changes = np.diff(record.channels, prepend=-1) | np.diff(blocks, prepend=-1)
        firsts = np.flatnonzero(changes).tolist()
        for first, last in pairwise([*firsts, len(blocks)]):
            key = int(record.channels[first]), int(blocks[first])
            parts[key].append(record.select_records(slice(first, last)))
    begins = times[starts]
    groups = [
        _encode_block(*key, int(begins[key[1]]), part, timestep) for key, part in parts.items()
    ]
    return groups, begins


def _encode_block(
    channel: int, row: int, time: int, parts: Sequence[Records], timestep: float
) -> MessageGroup:
    sizes = [len(part.rows) * part.layout.packed for part in parts]
    head = message_head(len(parts) * _GROUP_HEAD.size + sum(sizes), channel, time)

    def write(data: Bytes, starts: Integers) -> None:
        data, before = data[starts[0] :], head
        for part, size in zip(parts, sizes, strict=True):
            count, length = len(part.rows), part.layout.size
            records = SCRATCH.take_buffer("block", count * length)
            write_records(part, records, np.arange(count) * length)
            before += _GROUP_HEAD.pack(count, length, timestep)
            data[: len(before)] = np.frombuffer(before, np.uint8)
            # Planes are spread over memory, so they are gathered in a small buffer.
            packed = SCRATCH.take_buffer("packed", size)
            pack_values(records, part.layout, packed)
            data[len(before) :][:size] = packed
            data, before = data[len(before) + size :], b""

    size = len(head) + len(parts) * _GROUP_HEAD.size + sum(sizes)
    return MessageGroup(np.array([channel]), np.array([row]), size, write)


def expand_file(data: bytes) -> bytes:
    """Return a trace file in the message form, byte for byte as it would have been written.

    A file in that form is returned unchanged. Raises the errors in `UNREADABLE`.
    """
    stored = stored_file(data)
    file = expand_blocks(stored)
    return data if file is stored else encode_file(file_start_of(file), message_stream(file))


def expand_blocks(file: StoredFile) -> StoredFile:
    """Return a file in the compact form as one of messages, and any other unchanged."""
    blocks = [channel for channel in file.channels if channel.message_encoding == BLOCKS]
    others = [channel for channel in file.channels if channel not in blocks]
    if not blocks:
        return file
    named_blocks = [
        (channel, *group)
        for channel in blocks
        for content in file.messages[channel.id].iterate_contents()
        for group in read_block(channel, content)
    ]
    times = np.concatenate(
        [items["log_time"] for channel, _, items in named_blocks if channel.topic == STATE_TOPIC]
    )
    if np.any(times[1:] <= times[:-1]):
        raise ValueError("its states are not in order of time")
    groups = [_message_group(*block, times) for block in named_blocks]
    for channel in others:
        [content] = file.messages[channel.id].iterate_contents()
        groups.append(single_message(channel.id, len(times) - 1, int(times[-1]), content))
    stream = interleave_groups(groups, len(file.channels), times)
    if np.count_nonzero(stream.sizes) != sum(len(group.rows) for group in groups):
        raise ValueError("a channel has two messages of one time")
    data = stream.data.copy()
    messages = {
        number: ChannelMessages(data, starts[stream.sizes[:, number - 1] > 0])
        for number, starts in enumerate(stream.offsets.T, start=1)
    }
    channels = [*(replace(block, message_encoding=PROTOBUF) for block in blocks), *others]
    return replace(file, channels=channels, messages=messages)


def _message_group(
    channel: Channel, layout: MessageLayout, items: Items, times: Times
) -> MessageGroup:
    rows = np.searchsorted(times, items["log_time"])
    if np.any(np.diff(rows) <= 0) or np.any(times[rows] != items["log_time"]):
        raise ValueError(f"messages of {channel.topic} are out of order, or have no state")

    def write(data: Bytes, starts: Integers) -> None:
        # NumPy copies records field by field, and bytes at once.
        overlapping_view(data, layout.size)[starts] = items.view(f"V{layout.size}")

    return MessageGroup(np.full_like(rows, channel.id), rows, layout.size, write)


def read_block(channel: Channel, content: bytes) -> Iterator[tuple[MessageLayout, Items]]:
    """Yield the messages of a block, group by group. Raises the errors in `UNREADABLE`."""
    start = 0
    # Upper bound of the bytes of a message over the bytes of its stored values.
    max_expansion = 4
    while start < len(content):
        count, size, timestep = _GROUP_HEAD.unpack_from(content, start)
        start += _GROUP_HEAD.size
        if not count or count * size > max_expansion * (len(content) - start):
            raise ValueError(f"a block of {channel.topic} claims more messages than it holds")
        # The size of a message tells its layout.
        if channel.topic != STATE_TOPIC:
            layout = contacts_record(int(point_counts(np.array(size))))
        else:
            sizes = int(channel.metadata["nq"]), int(channel.metadata["nv"])
            layouts = last_state_record(*sizes), state_record(*sizes, 0), state_record(*sizes, 3)
            layout = {each.size: each for each in layouts}[size]
        items = layout.fill_items(np.empty(count * size, np.uint8))
        for width, places in layout.values:
            length = width * len(places) * count
            planes = np.frombuffer(content, np.uint8, length, start)
            unpack_values(planes, items, width, places)
            start += length
        items["channel"] = channel.id
        items["publish_time"] = items["log_time"]
        if channel.topic != STATE_TOPIC:
            net = items["normal_force"], items["tangential_force"], items["distance"]
            for name, values in derived_fields(*net, timestep).items():
                items[name] = values
        yield layout, items
