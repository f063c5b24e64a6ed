"""The compact form of a trace: its messages column by column, in blocks.

A block is what one channel says in a stretch of time: its messages grouped by their length, each
group as a head and the values of its messages. Values of one width lie together, as their second
differences from message to message: integers of that width that wrap around, signs folded in
(zigzag), first the lowest byte of all values, column by column, then the next byte. What follows
from other values is left out, so nothing is lost: blocks give every message again, byte for byte.
"""

import struct
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from mcap.records import Channel
from numpy.typing import NDArray

from contactlab.store.mcap.file_parts import encode_file, interleave
from contactlab.store.mcap.message_encoder import MessageGroup, Times, derived, single_message
from contactlab.store.mcap.record_encoder import (
    Bytes,
    Integers,
    Items,
    Records,
    Unsigned,
    overlapping,
    overlapping_numbers,
    pack_values,
    write_records,
)
from contactlab.store.mcap.scratch import SCRATCH
from contactlab.store.mcap.stored_messages import (
    ChannelMessages,
    StoredFile,
    message_stream,
    start_of,
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
"""The message encoding of the channels whose messages are blocks."""
BLOCK_SIZE = 8 << 20
"""Bytes of messages in the blocks of one stretch of time, but for what one step adds."""
_HEAD = struct.Struct("<IId")  # messages of a group, length of each, and the run's timestep [s]
# No message has so many times the bytes of the values that are stored of it.
_MOST_BYTES_PER_STORED_BYTE = 4


def compacted(
    records: Sequence[Records], times: Times, timestep: float
) -> tuple[list[MessageGroup], Times]:
    """Return the messages of (N + 1,) times as blocks, and the (B,) times at which these start."""
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
            parts[key].append(record.part(slice(first, last)))
    begins = times[starts]
    found = [_block(*key, int(begins[key[1]]), part, timestep) for key, part in parts.items()]
    return found, begins


def _block(
    channel: int, row: int, time: int, parts: Sequence[Records], timestep: float
) -> MessageGroup:
    """Return the message that is a block of these records."""
    sizes = [len(part.rows) * part.layout.packed for part in parts]
    head = message_head(len(parts) * _HEAD.size + sum(sizes), channel, time)

    def write(data: Bytes, starts: Integers) -> None:
        data, before = data[starts[0] :], head
        for part, size in zip(parts, sizes, strict=True):
            count, length = len(part.rows), part.layout.size
            records = SCRATCH.take("block", count * length)
            write_records(part, records, np.arange(count) * length)
            before += _HEAD.pack(count, length, timestep)
            data[: len(before)] = np.frombuffer(before, np.uint8)
            # Planes lie far apart: they are gathered where memory is fast.
            packed = SCRATCH.take("packed", size)
            pack_values(records, part.layout, packed)
            data[len(before) :][:size] = packed
            data, before = data[len(before) + size :], b""

    size = len(head) + len(parts) * _HEAD.size + sum(sizes)
    return MessageGroup(np.array([channel]), np.array([row]), size, write)


def expanded(data: bytes) -> bytes:
    """Return a trace file in the message form, byte for byte as it would have been written.

    One that has that form is returned as it is. Raises what is in `UNREADABLE`.
    """
    stored = stored_file(data)
    file = in_messages(stored)
    return data if file is stored else encode_file(start_of(file), message_stream(file))


def in_messages(file: StoredFile) -> StoredFile:
    """Return a file in the compact form as one of messages, and any other as it is."""
    blocks = [channel for channel in file.channels if channel.message_encoding == BLOCKS]
    others = [channel for channel in file.channels if channel not in blocks]
    if not blocks:
        return file
    found = [
        (channel, *group)
        for channel in blocks
        for content in file.messages[channel.id].contents()
        for group in _read_block(channel, content)
    ]
    times = np.concatenate(
        [items["log_time"] for channel, _, items in found if channel.topic == STATE_TOPIC]
    )
    if np.any(times[1:] <= times[:-1]):
        raise ValueError("its states are not in order of time")
    groups = [_group(*block, times) for block in found]
    for channel in others:
        [content] = file.messages[channel.id].contents()
        groups.append(single_message(channel.id, len(times) - 1, int(times[-1]), content))
    stream = interleave(groups, len(file.channels), times)
    if np.count_nonzero(stream.sizes) != sum(len(group.rows) for group in groups):
        raise ValueError("a channel has two messages of one time")
    data = stream.data.copy()
    messages = {
        number: ChannelMessages(data, starts[stream.sizes[:, number - 1] > 0])
        for number, starts in enumerate(stream.offsets.T, start=1)
    }
    channels = [*(replace(block, message_encoding=PROTOBUF) for block in blocks), *others]
    return replace(file, channels=channels, packed={}, messages=messages)


def _group(channel: Channel, layout: MessageLayout, items: Items, times: Times) -> MessageGroup:
    rows = np.searchsorted(times, items["log_time"])
    if np.any(np.diff(rows) <= 0) or np.any(times[rows] != items["log_time"]):
        raise ValueError(f"messages of {channel.topic} are out of order, or have no state")

    def write(data: Bytes, starts: Integers) -> None:
        # NumPy copies records field by field, and bytes at once.
        overlapping(data, layout.size)[starts] = items.view(f"V{layout.size}")

    return MessageGroup(np.full_like(rows, channel.id), rows, layout.size, write)


def _read_block(channel: Channel, content: bytes) -> Iterator[tuple[MessageLayout, Items]]:
    """Yield the groups of messages of a block."""
    start = 0
    while start < len(content):
        count, size, timestep = _HEAD.unpack_from(content, start)
        start += _HEAD.size
        if not count or count * size > _MOST_BYTES_PER_STORED_BYTE * (len(content) - start):
            raise ValueError(f"a block of {channel.topic} claims more messages than it holds")
        layout = _layout(channel, size)
        items = layout.fill(np.empty(count * size, np.uint8))
        for width, places in layout.values:
            length = width * len(places) * count
            planes = np.frombuffer(content, np.uint8, length, start)
            overlapping_numbers(items, width)[:, places] = _undone(planes, width, count)
            start += length
        items["channel"] = channel.id
        items["publish_time"] = items["log_time"]
        if channel.topic != STATE_TOPIC:
            net = items["normal_force"], items["tangential_force"], items["distance"]
            for name, values in derived(*net, timestep).items():
                items[name] = values
        yield layout, items


def _layout(channel: Channel, size: int) -> MessageLayout:
    """Return the layout of messages of a length, in a channel."""
    if channel.topic != STATE_TOPIC:
        return contacts_record(int(point_counts(np.array(size))))
    sizes = int(channel.metadata["nq"]), int(channel.metadata["nv"])
    known = last_state_record(*sizes), state_record(*sizes, 0), state_record(*sizes, 3)
    return {layout.size: layout for layout in known}[size]


def _undone(planes: NDArray[np.uint8], width: int, count: int) -> Unsigned:
    """Return the (count, k) values of the bytes that `_columns` made of them."""
    folded = np.ascontiguousarray(planes.reshape(width, -1).T).view(f"<u{width}")
    values = np.bitwise_xor(folded >> 1, np.negative(folded & 1))
    values = values.reshape(-1, count).T
    for _ in range(2):
        values = np.cumsum(values, axis=0, dtype=values.dtype)
    return values
