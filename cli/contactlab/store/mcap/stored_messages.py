"""Reads messages of a trace file as stored, and checks that the file is valid.

Viewers rely on more than readable messages: they seek by the summary, the message indexes and the
statistics, and expect messages in order of time. So a file must equal, byte for byte, the file
that its messages encode to.
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


@dataclass(frozen=True)
class ChannelMessages:
    """The Message records of one channel, scattered over a buffer."""

    data: NDArray[np.uint8]  # (bytes,) the content of all chunks
    offsets: NDArray[np.int64]  # (M,) start of each record, in time order

    @property
    def heads(self) -> NDArray[np.void]:
        """(M,) the start of each record, before its content."""
        return overlapping_view(self.data, HEAD.itemsize)[self.offsets].view(HEAD)

    @property
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
        items = overlapping_view(self.data, layout.size)[self.offsets[chosen]]
        bytes_of = items.view(np.uint8).reshape(len(items), layout.size)
        template = np.frombuffer(layout.template, np.uint8)
        if np.any(bytes_of[:, layout.constant] != template[layout.constant]):
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
    packed: Mapping[int, bytes]  # compressed chunks, by the time of their first message
    messages: Mapping[int, ChannelMessages]  # by the id of their channel


def stored_file(data: bytes) -> StoredFile:
    """Return the parsed content of a file without damage; see `find_damage` and `UNREADABLE`."""
    reader = SeekingReader(BytesIO(data))
    summary = reader.get_summary()
    assert summary is not None, "find_damage() finds a missing summary"
    schemas = {schema.data for schema in summary.schemas.values()}
    for message in (STATE, CONTACTS):
        if file_descriptor_set(message) not in schemas:
            raise ValueError(f"its schema of {message.name} differs")
    [metadata], [model] = reader.iter_metadata(), reader.iter_attachments()
    if sum(chunk.uncompressed_size for chunk in summary.chunk_indexes) > MOST_TRACE:
        raise ValueError("its chunks claim to hold more data than any run records")
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
    stream = np.frombuffer(b"".join(map(unpack_chunk, packed.values(), sizes)), np.uint8)
    none = np.empty(0, np.int64)
    messages = {
        channel: ChannelMessages(stream, np.concatenate((none, *parts)))
        for channel, parts in offsets.items()
    }
    described = [*summary.schemas.values()], [*summary.channels.values()]
    return StoredFile(*described, metadata, model, packed, messages)


def unpack_chunk(compressed: bytes, size: int) -> bytes:
    """Return the content of a chunk; both the chunk and the compressed data state its size."""
    # Largest accepted chunk [bytes]: a written one has 1 MiB and the records of one step.
    if size > 64 << 20 or zstandard.frame_content_size(compressed) != size:
        raise ValueError(f"a chunk claims to hold {size:,} bytes")
    return zstandard.decompress(compressed)


def find_defect(data: bytes) -> str | None:
    """Return how a file differs from the encoding of its messages; None if it is valid."""
    if damage := find_damage(data):
        return damage
    try:
        again = encode_again(stored_file(data))
    except UNREADABLE as error:
        return f"a record cannot be decoded: {error}"
    return None if again == data else "its chunks, indexes or summary do not match its messages"


def encode_again(file: StoredFile) -> bytes:
    """Return the file that stored messages encode to, with chunks compressed as before."""
    stream = message_stream(file)
    rows = np.searchsorted(stream.times, np.array([*file.packed], np.uint64)).tolist()
    packed = dict(zip(rows, file.packed.values(), strict=True))
    return encode_file(file_start_of(file), stream, packed)


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
