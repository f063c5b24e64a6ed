"""Messages of a trace file as they lie there, and whether these are sound.

Viewers rely on more than readable messages: they seek by the summary, the message indexes and the
statistics, and expect messages in order of time. So a file must be, byte for byte, what is written
of its messages.
"""

import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO

import numpy as np
import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, Metadata, Schema
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from contactlab.store.mcap.file_parts import (
    CHUNK_HEAD,
    DATA_END,
    FOOTER,
    FRAME,
    SIZE,
    FileStart,
    MessageStream,
    encode_file,
    file_start,
    with_metadata,
)
from contactlab.store.mcap.message_encoder import STATE_CHANNEL
from contactlab.store.mcap.record_encoder import INDEX_HEAD, overlapping
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
"""Errors of a file that has its checksums, but is not ours."""
_MOST_BYTES_OF_A_CHUNK = 64 << 20
"""Bytes that a chunk may hold: one that is written has 1 MiB, and as much as one step records."""


def find_damage(data: bytes) -> str | None:
    """Return what is wrong with a file's magic bytes or checksums; None if nothing is.

    The two checksums cover all bytes, so any flipped byte is found.
    """
    end = len(data) - len(MCAP0_MAGIC)
    tail = end - FOOTER.size
    if tail < len(MCAP0_MAGIC) + DATA_END.size or not data.startswith(MCAP0_MAGIC):
        return "this is no MCAP file"
    if not data.endswith(MCAP0_MAGIC):
        return "the file is truncated, or its end is damaged"
    *_, start, offsets, _ = FOOTER.unpack_from(data, tail)
    data_end = start - DATA_END.size
    if not 0 <= data_end <= tail - DATA_END.size:
        return "the footer does not say where the summary is"
    view, length = memoryview(data), FOOTER.size - FRAME.size
    crc = zlib.crc32(view[start : end - SIZE.size])
    if data[tail:end] != FOOTER.pack(Opcode.FOOTER, length, start, offsets, crc):
        return "the summary does not match its checksum"
    if data[data_end:start] != DATA_END.pack(
        Opcode.DATA_END, SIZE.size, zlib.crc32(view[:data_end])
    ):
        return "the data section does not match its checksum"
    return None


@dataclass(frozen=True)
class ChannelMessages:
    """The Message records of one channel, scattered over a buffer."""

    data: NDArray[np.uint8]  # (bytes,) the content of all chunks
    offsets: NDArray[np.int64]  # (M,) where each record starts, in time order

    @property
    def heads(self) -> NDArray[np.void]:
        """(M,) the start of each record, before its content."""
        return overlapping(self.data, HEAD.itemsize)[self.offsets].view(HEAD)

    @property
    def sizes(self) -> NDArray[np.int64]:
        """(M,) length of each record, opcode and length included."""
        lengths = self.heads["length"]
        if np.any(lengths > len(self.data)):
            raise ValueError("a message is larger than its chunk")
        return lengths.astype(np.int64) + FRAME.size

    def pick(self, chosen: slice | NDArray[np.bool_], layout: MessageLayout) -> NDArray[np.void]:
        """Return the chosen records, all of which must have this layout."""
        items = overlapping(self.data, layout.size)[self.offsets[chosen]]
        bytes_of = items.view(np.uint8).reshape(len(items), layout.size)
        template = np.frombuffer(layout.template, np.uint8)
        if np.any(bytes_of[:, layout.constant] != template[layout.constant]):
            raise ValueError("a message has other fields than its schema")
        return items.view(layout.dtype)

    def contents(self) -> Iterator[bytes]:
        """Yield the content of each message."""
        for start, size in zip(self.offsets.tolist(), self.sizes.tolist(), strict=True):
            yield self.data[start + HEAD.itemsize : start + size].tobytes()


@dataclass(frozen=True)
class StoredFile:
    """A trace file, by its own summary and indexes."""

    schemas: Sequence[Schema]
    channels: Sequence[Channel]
    metadata: Metadata
    model: Attachment
    packed: Mapping[int, bytes]  # compressed chunks, by the time of their first message
    messages: Mapping[int, ChannelMessages]  # by the id of their channel


def stored_file(data: bytes) -> StoredFile:
    """Return what a file holds in which `find_damage` finds nothing; see `UNREADABLE`."""
    reader = SeekingReader(BytesIO(data))
    summary = reader.get_summary()
    assert summary is not None, "find_damage() finds a missing summary"
    schemas = {schema.data for schema in summary.schemas.values()}
    for message in (STATE, CONTACTS):
        if file_descriptor_set(message) not in schemas:
            raise ValueError(f"it has another schema of {message.name}")
    [metadata], [model] = reader.iter_metadata(), reader.iter_attachments()
    if sum(chunk.uncompressed_size for chunk in summary.chunk_indexes) > MOST_TRACE:
        raise ValueError("its chunks claim to hold more than any run records")
    offsets: dict[int, list[NDArray[np.int64]]] = {channel: [] for channel in summary.channels}
    packed: dict[int, bytes] = {}
    base = 0
    for chunk in summary.chunk_indexes:
        start = chunk.chunk_start_offset + CHUNK_HEAD.size
        packed[chunk.message_start_time] = data[start : start + chunk.compressed_size]
        for channel, start in chunk.message_index_offsets.items():
            *_, length = INDEX_HEAD.unpack_from(data, start)
            entries = np.frombuffer(data, "<u8", length // 8, start + INDEX_HEAD.size)
            offsets[channel].append(entries[1::2].astype(np.int64) + base)
        base += chunk.uncompressed_size
    sizes = (chunk.uncompressed_size for chunk in summary.chunk_indexes)
    stream = np.frombuffer(b"".join(map(unpacked, packed.values(), sizes)), np.uint8)
    none = np.empty(0, np.int64)
    messages = {
        channel: ChannelMessages(stream, np.concatenate((none, *parts)))
        for channel, parts in offsets.items()
    }
    described = [*summary.schemas.values()], [*summary.channels.values()]
    return StoredFile(*described, metadata, model, packed, messages)


def unpacked(compressed: bytes, size: int) -> bytes:
    """Return the content of a chunk, whose size both the chunk and the compressed data state."""
    if size > _MOST_BYTES_OF_A_CHUNK or zstandard.frame_content_size(compressed) != size:
        raise ValueError(f"a chunk claims to hold {size:,} bytes")
    return zstandard.decompress(compressed)


def find_defect(data: bytes) -> str | None:
    """Return how a file is not what is written of its messages; None if it is sound."""
    if damage := find_damage(data):
        return damage
    try:
        again = written_again(stored_file(data))
    except UNREADABLE as error:
        return f"a record cannot be decoded: {error}"
    return None if again == data else "its chunks, indexes or summary are not those of its messages"


def written_again(file: StoredFile) -> bytes:
    """Return the file that stored messages give, whose chunks are compressed as they were."""
    stream = message_stream(file)
    rows = np.searchsorted(stream.times, np.array([*file.packed], np.uint64)).tolist()
    packed = dict(zip(rows, file.packed.values(), strict=True))
    return encode_file(start_of(file), stream, packed)


def start_of(file: StoredFile) -> FileStart:
    """Return how a file begins that has these schemas, channels, model and metadata."""
    start = file_start(file.schemas, file.channels, file.model)
    return with_metadata(start, file.metadata.name, file.metadata.metadata)


def message_stream(file: StoredFile) -> MessageStream:
    """Return stored messages as they are to lie in the chunks, one after the other."""
    state = file.messages[STATE_CHANNEL]
    times = state.heads["log_time"]
    if np.any(times[1:] <= times[:-1]):
        raise ValueError("its states are not in order of time")
    sizes = np.zeros((len(times), len(file.messages)), np.int64)
    for channel, message in file.messages.items():
        heads = message.heads
        if np.any((heads["opcode"] != Opcode.MESSAGE) | (heads["channel"] != channel)):
            raise ValueError("a message index points at something else")
        sizes[np.searchsorted(times, heads["log_time"]), channel - 1] = message.sizes
    ends = np.cumsum(sizes)
    return MessageStream(state.data[: ends[-1]], ends.reshape(sizes.shape) - sizes, sizes, times)
