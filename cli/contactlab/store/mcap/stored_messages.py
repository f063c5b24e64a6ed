"""Reads messages of a trace file as stored."""

import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from io import BytesIO
from typing import NamedTuple, TypeVar

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata, Schema
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from contactlab.disk_arrays import disk_memory_in_use
from contactlab.store.mcap.file_parts import (
    CHANNEL_NUMBER,
    CHUNK_HEAD,
    CHUNK_INDEX,
    DATA_END,
    FOOTER,
    FRAME,
    SIZE,
    SIZES,
    Compressed,
    FileStart,
    MessageStream,
    file_start,
    with_metadata,
)
from contactlab.store.mcap.message_encoder import STATE_CHANNEL
from contactlab.store.mcap.record_encoder import INDEX_HEAD, overlapping_view
from contactlab.store.mcap.trace_messages import (
    CONTACTS,
    HEAD,
    STATE,
    MessageLayout,
    file_descriptor_set,
)
from contactlab.store.store_files import MOST_TRACE

UNREADABLE = (
    McapError,
    struct.error,
    zstandard.ZstdError,
    ValueError,
    LookupError,
    ArithmeticError,
    MemoryError,
)
"""Errors of a file that has valid checksums, but a different content."""


def find_damage(data: bytes) -> str | None:
    """Return the damage of a file's magic bytes or checksums; None if there is none.

    The two checksums cover all bytes, so any flipped byte is found.
    """
    end = len(data) - len(MCAP0_MAGIC)
    tail = end - FOOTER.size
    if tail < len(MCAP0_MAGIC) + DATA_END.size or not data.startswith(MCAP0_MAGIC):
        return "this is not an MCAP file"
    if not data.endswith(MCAP0_MAGIC):
        return "the file is truncated, or its end is damaged"
    *_, start, offsets, _ = FOOTER.unpack_from(data, tail)
    data_end = start - DATA_END.size
    if not 0 <= data_end <= tail - DATA_END.size:
        return "the footer has no valid position of the summary"
    view, length = memoryview(data), FOOTER.size - FRAME.size
    crc = zlib.crc32(view[start : end - SIZE.size])
    if data[tail:end] != FOOTER.pack(Opcode.FOOTER, length, start, offsets, crc):
        return "the summary does not match its checksum"
    if data[data_end:start] != DATA_END.pack(
        Opcode.DATA_END, SIZE.size, zlib.crc32(view[:data_end])
    ):
        return "the data section does not match its checksum"
    return None


# Records that are compared with their layout at a time, so that they stay in the cache [bytes].
_COMPARED_BYTES = 1 << 18


@dataclass(frozen=True)
class ChannelMessages:
    """The Message records of one channel, scattered over a buffer."""

    data: NDArray[np.uint8]  # (bytes,) the content of all chunks
    offsets: NDArray[np.int64]  # (M,) start of each record, in time order

    @cached_property
    def heads(self) -> NDArray[np.void]:
        """(M,) the start of each record, before its content."""
        return overlapping_view(self.data, HEAD.itemsize)[self.offsets].view(HEAD)

    @cached_property
    def sizes(self) -> NDArray[np.int64]:
        """(M,) length of each record, opcode and length included."""
        lengths = self.heads["length"]
        if np.any(lengths > len(self.data)):
            raise ValueError("a message is larger than its chunk")
        return lengths.astype(np.int64) + FRAME.size

    def pick_records(
        self, chosen: slice | NDArray[np.bool_], layout: MessageLayout
    ) -> NDArray[np.void]:
        """Return the chosen records; all must have this layout."""
        offsets = self.offsets[chosen]
        items = np.empty(len(offsets), f"V{layout.size}")
        batch = max(1, _COMPARED_BYTES // layout.size)
        for first in range(0, len(offsets), batch):
            part = items[first : first + batch]
            part[:] = overlapping_view(self.data, layout.size)[offsets[first : first + batch]]
            different = part.view(np.uint8).reshape(len(part), layout.size) ^ layout.template_bytes
            different &= layout.mask
            if different.any():
                raise ValueError("a message has other fields than its schema")
        return items.view(layout.dtype)

    def iterate_contents(self) -> Iterator[bytes]:
        """Yield the content of each message."""
        for start, size in zip(self.offsets.tolist(), self.sizes.tolist(), strict=True):
            yield self.data[start + HEAD.itemsize : start + size].tobytes()


@dataclass(frozen=True)
class StoredFile:
    """A trace file, parsed by its own summary and indexes."""

    schemas: Sequence[Schema]
    channels: Sequence[Channel]
    metadata: Metadata
    model: Attachment
    messages: Mapping[int, ChannelMessages]  # by the id of their channel


@dataclass(frozen=True)
class ChunkEntry:
    """A chunk, as the summary describes it."""

    first_time: int
    start: int
    size: int
    unpacked_size: int
    index_starts: Mapping[int, int]  # by channel


class Summary(NamedTuple):
    """The records of a file's summary, and those that it refers to."""

    schemas: Mapping[int, Schema]
    channels: Mapping[int, Channel]
    chunks: Sequence[ChunkEntry]
    metadata: Sequence[Metadata]
    attachments: Sequence[Attachment]


_Record = TypeVar("_Record", Schema, Channel, Metadata, Attachment)


# Runs of one scene share these records.
@lru_cache(maxsize=64)
def _parse_record(kind: type[_Record], content: bytes) -> _Record:
    return kind.read(ReadDataStream(BytesIO(content)))


def read_summary(data: bytes) -> Summary:
    """Return the summary of a file without damage. Raises the errors in `UNREADABLE`."""
    tail = len(data) - len(MCAP0_MAGIC) - FOOTER.size
    *_, place, end, _ = FOOTER.unpack_from(data, tail)
    schemas, channels = dict[int, Schema](), dict[int, Channel]()
    chunks, metadata, attachments = list[ChunkEntry](), list[Metadata](), list[Attachment]()
    while place < end:
        kind, content = _record_at(data, place)
        place += FRAME.size + len(content)
        match kind:
            case Opcode.SCHEMA:
                schema = _parse_record(Schema, content)
                schemas[schema.id] = schema
            case Opcode.CHANNEL:
                channel = _parse_record(Channel, content)
                channels[channel.id] = channel
            case Opcode.CHUNK_INDEX:
                first, _, start, _ = CHUNK_INDEX.unpack_from(content)
                (length,) = SIZE.unpack_from(content, CHUNK_INDEX.size)
                map_start = CHUNK_INDEX.size + SIZE.size
                places = CHANNEL_NUMBER.iter_unpack(content[map_start : map_start + length])
                compressed, unpacked = SIZES.unpack(content[-SIZES.size :])
                chunks.append(ChunkEntry(first, start, compressed, unpacked, dict(places)))
            case Opcode.METADATA_INDEX | Opcode.ATTACHMENT_INDEX:
                target, inner = _record_at(data, SIZES.unpack_from(content)[0])
                if kind == Opcode.METADATA_INDEX and target == Opcode.METADATA:
                    metadata.append(Metadata.read(ReadDataStream(BytesIO(inner))))
                elif kind == Opcode.ATTACHMENT_INDEX and target == Opcode.ATTACHMENT:
                    attachments.append(_parse_record(Attachment, inner))
            case _:
                pass
    definitions = {schema.data for schema in schemas.values()}
    for message in (STATE, CONTACTS):
        if file_descriptor_set(message) not in definitions:
            raise ValueError(f"its schema of {message.name} differs")
    # A run may record 16 GiB, and messages have tags.
    if sum(chunk.unpacked_size for chunk in chunks) > 32 << 30:
        raise ValueError("its chunks claim to hold more data than any run records")
    return Summary(schemas, channels, chunks, metadata, attachments)


def _record_at(data: bytes, place: int) -> tuple[int, bytes]:
    kind, length = FRAME.unpack_from(data, place)
    content = data[place + FRAME.size : place + FRAME.size + length]
    if len(content) != length:
        raise ValueError("a record is longer than its file")
    return kind, content


def stored_file(data: bytes) -> StoredFile:
    """Return the parsed content of a file without damage; see `find_damage` and `UNREADABLE`."""
    summary = read_summary(data)
    [metadata], [model] = summary.metadata, summary.attachments
    if not disk_memory_in_use() and sum(c.unpacked_size for c in summary.chunks) > MOST_TRACE:
        raise ValueError("its chunks claim to hold more data than a short run records")
    offsets: dict[int, list[NDArray[np.int64]]] = {channel: [] for channel in summary.channels}
    packed, base = list[memoryview](), 0
    for chunk in summary.chunks:
        start = chunk.start + CHUNK_HEAD.size
        packed.append(memoryview(data)[start : start + chunk.size])
        for channel, start in chunk.index_starts.items():
            *_, length = INDEX_HEAD.unpack_from(data, start)
            entries = np.frombuffer(data, "<u8", length // 8, start + INDEX_HEAD.size)
            offsets[channel].append(entries[1::2].astype(np.int64) + base)
        base += chunk.unpacked_size
    sizes = [chunk.unpacked_size for chunk in summary.chunks]
    for chunk, size in zip(packed, sizes, strict=True):
        check_chunk_size(chunk, size)
    stream, start = np.empty(sum(sizes), np.uint8), 0
    for chunk, size in zip(packed, sizes, strict=True):
        unpack_chunk(chunk, stream[start : start + size])
        start += size
    none = np.empty(0, np.int64)
    messages = {
        channel: ChannelMessages(stream, np.concatenate((none, *parts)))
        for channel, parts in offsets.items()
    }
    described = [*summary.schemas.values()], [*summary.channels.values()]
    return StoredFile(*described, metadata, model, messages)


def check_chunk_size(chunk: Compressed, size: int) -> None:
    """Raise a ValueError if a chunk is not of this size, or of too large a one."""
    # Largest accepted chunk [bytes]: a written one has 1 MiB and the records of one step.
    if size > 64 << 20 or zstandard.frame_content_size(chunk) != size:
        raise ValueError(f"a chunk claims to hold {size:,} bytes")


def unpack_chunk(chunk: Compressed, content: NDArray[np.uint8]) -> None:
    """Unpack a chunk into its place. Raises a ValueError if it is of another size."""
    with zstandard.ZstdDecompressor().stream_reader(chunk) as reader:
        # Its own checksum is read after the content.
        if reader.readinto(content.data) != len(content) or reader.read(1):
            raise ValueError("a chunk holds another number of bytes than it claims")


def file_start_of(file: StoredFile) -> FileStart:
    """Return the start of a file with these schemas, channels, model and metadata."""
    start = file_start(file.schemas, file.channels, file.model)
    return with_metadata(start, file.metadata.name, file.metadata.metadata)


def message_stream(file: StoredFile) -> MessageStream:
    """Return stored messages in the order of the chunks, one after the other."""
    state = file.messages[STATE_CHANNEL]
    times = state.heads["log_time"]
    if np.any(times[1:] <= times[:-1]):
        raise ValueError("its states are not in order of time")
    sizes = np.zeros((len(times), len(file.messages)), np.int64)
    for channel, message in file.messages.items():
        heads = message.heads
        if np.any((heads["opcode"] != Opcode.MESSAGE) | (heads["channel"] != channel)):
            raise ValueError("a message index does not point at a message of its channel")
        sizes[np.searchsorted(times, heads["log_time"]), channel - 1] = message.sizes
    ends = np.cumsum(sizes)
    return MessageStream(state.data[: ends[-1]], ends.reshape(sizes.shape) - sizes, sizes, times)
