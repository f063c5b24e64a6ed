"""The parts of a trace file: its start, its chunks with their indexes, and its end.

Messages are interleaved in order of time, split into chunks and indexed by NumPy.
Source of the file's structure and of the record layouts: https://mcap.dev/spec
"""

import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from contactlab.store.mcap.message_encoder import SCRATCH, MessageGroup

Times = NDArray[np.uint64]

CHUNK_SIZE = 1 << 20
_COMPRESSION = "zstd"

CHUNK_HEAD = struct.Struct(f"<BQQQQII{len(_COMPRESSION)}sQ")
INDEX_HEAD = struct.Struct("<BQHI")
# The content's checksum is zstd's own, which takes a tenth of the time and which decoders verify.
_NO_CRC = 0
_FRAME_SIZE = 9
_ENTRY_SIZE = 16
LIBRARY = "contactlab"
_CRC_SIZE = 4
# Six of these in every file: by the library they would take a tenth of the time of a tiny run.
_SUMMARY_OFFSET = struct.Struct("<BQBQQ")


@dataclass(frozen=True)
class FilePrefix:
    """The start of a file up to its metadata, which the runs of one scene share.

    Attributes:
        crc: CRC-32 of its bytes.
        topics: topics of the channels 1, 2, ...
        schemas: Schema records, for the summary.
        channels: Channel records, likewise.
        attachment: AttachmentIndex record, likewise.
    """

    data: bytes
    crc: int
    topics: tuple[str, ...]
    schema_count: int
    schemas: bytes
    channels: bytes
    attachment: bytes


@dataclass(frozen=True)
class FileHead:
    """The start of a file up to its first chunk.

    Attributes:
        metadata: the Metadata record.
        metadata_index: its MetadataIndex record, for the summary.
    """

    prefix: FilePrefix
    metadata: bytes
    metadata_index: bytes

    @property
    def data(self) -> bytes:
        """The bytes."""
        return self.prefix.data + self.metadata

    @property
    def crc(self) -> int:
        """Their CRC-32."""
        return zlib.crc32(self.metadata, self.prefix.crc)


def file_prefix(
    schemas: Sequence[Schema], channels: Sequence[Channel], attachment: Attachment
) -> FilePrefix:
    """Return the start of a file; channels are numbered from 1."""
    schema_records, channel_records = _encoded(*schemas), _encoded(*channels)
    header = _encoded(Header(profile="", library=LIBRARY))
    before = MCAP0_MAGIC + header + schema_records + channel_records
    attached = _encoded(attachment)
    index = AttachmentIndex(
        offset=len(before),
        length=len(attached),
        log_time=attachment.log_time,
        create_time=attachment.create_time,
        data_size=len(attachment.data),
        name=attachment.name,
        media_type=attachment.media_type,
    )
    return FilePrefix(
        data=before + attached,
        crc=zlib.crc32(before + attached),
        topics=tuple(channel.topic for channel in channels),
        schema_count=len(schemas),
        schemas=schema_records,
        channels=channel_records,
        attachment=_encoded(index),
    )


def file_head(prefix: FilePrefix, name: str, entries: Mapping[str, str]) -> FileHead:
    """Return the start of a file with its metadata."""
    metadata = _encoded(Metadata(name, dict(entries)))
    index = MetadataIndex(offset=len(prefix.data), length=len(metadata), name=name)
    return FileHead(prefix, metadata, _encoded(index))


def file_tail(
    head: FileHead, chunks: Sequence[ChunkIndex], message_counts: Sequence[int], crc: int
) -> bytes:
    """Return the end of a file: the data section's end, the summary, the footer.

    Args:
        head: the start of the file.
        chunks: index of each chunk; there is at least one.
        message_counts: number of messages of the channels 1, 2, ...
        crc: CRC-32 of all bytes before it.
    """
    prefix = head.prefix
    statistics = Statistics(
        attachment_count=1,
        channel_count=len(message_counts),
        channel_message_counts=dict(enumerate(message_counts, start=1)),
        chunk_count=len(chunks),
        message_count=sum(message_counts),
        message_end_time=chunks[-1].message_end_time,
        message_start_time=chunks[0].message_start_time,
        metadata_count=1,
        schema_count=prefix.schema_count,
    )
    groups = {
        Opcode.SCHEMA: prefix.schemas,
        Opcode.CHANNEL: prefix.channels,
        Opcode.STATISTICS: _encoded(statistics),
        Opcode.CHUNK_INDEX: _encoded(*chunks),
        Opcode.ATTACHMENT_INDEX: prefix.attachment,
        Opcode.METADATA_INDEX: head.metadata_index,
    }
    data_end = _encoded(DataEnd(crc))
    position = start = _chunk_end(chunks[-1]) + len(data_end)
    offsets = b""
    for opcode, group in groups.items():
        offsets += _SUMMARY_OFFSET.pack(Opcode.SUMMARY_OFFSET, 17, opcode, position, len(group))
        position += len(group)
    summary = b"".join(groups.values()) + offsets
    # The summary's CRC covers the footer's own first fields too.
    footer = _encoded(Footer(start, position, 0))[:-_CRC_SIZE]
    summary_crc = zlib.crc32(footer, zlib.crc32(summary)).to_bytes(_CRC_SIZE, "little")
    return data_end + summary + footer + summary_crc + MCAP0_MAGIC


def _chunk_end(chunk: ChunkIndex) -> int:
    """Return the offset in the file at which a chunk's last message index ends."""
    return chunk.chunk_start_offset + chunk.chunk_length + chunk.message_index_length


def _encoded(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()


@dataclass(frozen=True)
class MessageStream:
    """The messages of a whole run, interleaved.

    Attributes:
        data: (bytes,) Message records, ordered by state row, then by channel.
        offsets: (rows, channels) where each record starts.
        sizes: (rows, channels) its length; 0 where a channel has no message.
        times: (rows,) log time [ns].
    """

    data: NDArray[np.uint8]
    offsets: NDArray[np.int64]
    sizes: NDArray[np.int64]
    times: Times

    def cuts(self) -> list[int]:
        """Return the rows at which chunks start, and the number of rows.

        Records of one row stay together; a row that crosses a multiple of CHUNK_SIZE ends its
        chunk.
        """
        block = self.offsets[:, 0] // CHUNK_SIZE
        return [0, *(np.flatnonzero(np.diff(block)) + 1).tolist(), len(block)]


def interleave(groups: Sequence[MessageGroup], channels: int, times: Times) -> MessageStream:
    """Return the records of all groups in one buffer, valid until the next call."""
    sizes = np.zeros((len(times), channels), np.int64)
    for group in groups:
        sizes[group.span, group.channel - 1] = group.layout.size
    ends = np.cumsum(sizes)
    offsets = ends.reshape(sizes.shape) - sizes
    data = SCRATCH.take("stream", int(ends[-1]))
    for group in groups:
        records = overlapping(data, group.layout.size)
        records[offsets[group.span, group.channel - 1]] = _records(group, times)
    return MessageStream(data, offsets, sizes, times)


def _records(group: MessageGroup, times: Times) -> NDArray[np.void]:
    size = group.layout.size
    memory = SCRATCH.take("records", len(group.rows) * size)
    items = group.layout.fill(memory)
    items["channel"] = group.channel
    items["log_time"] = items["publish_time"] = times[group.span]
    group.fill(items)
    return items.view(f"V{size}")


def overlapping(data: NDArray[np.uint8], size: int) -> NDArray[np.void]:
    """Return a view whose item i is the `size` bytes that start at byte i."""
    return np.ndarray((max(len(data) - size + 1, 0),), f"V{size}", data, strides=(1,))


def chunk_records(stream: MessageStream, position: int) -> Iterator[tuple[list[bytes], ChunkIndex]]:
    """Yield each chunk and its message indexes as bytes, and its index for the summary.

    The first chunk is at a position in the file.
    """
    for start, stop in pairwise(stream.cuts()):
        rows = slice(start, stop)
        chunk, compressed_size, size = _chunk(stream, rows)
        indexes = dict(_message_indexes(stream, rows))
        chunk_length = sum(map(len, chunk))
        end, offsets = position + chunk_length, dict[int, int]()
        for channel, index in indexes.items():
            offsets[channel] = end
            end += len(index)
        yield (
            [*chunk, *indexes.values()],
            ChunkIndex(
                chunk_length=chunk_length,
                chunk_start_offset=position,
                compression=_COMPRESSION,
                compressed_size=compressed_size,
                message_end_time=int(stream.times[stop - 1]),
                message_index_length=end - position - chunk_length,
                message_index_offsets=offsets,
                message_start_time=int(stream.times[start]),
                uncompressed_size=size,
            ),
        )
        position = end


def _chunk(stream: MessageStream, rows: slice) -> tuple[list[bytes], int, int]:
    """Return a Chunk record in two parts, its compressed size and its own."""
    ends = stream.offsets[rows.stop, 0] if rows.stop < len(stream.times) else len(stream.data)
    content = stream.data[stream.offsets[rows.start, 0] : ends].data
    compressed = SCRATCH.compressor.compress(content)
    head = CHUNK_HEAD.pack(
        Opcode.CHUNK,
        CHUNK_HEAD.size - _FRAME_SIZE + len(compressed),
        int(stream.times[rows.start]),
        int(stream.times[rows.stop - 1]),
        len(content),
        _NO_CRC,
        len(_COMPRESSION),
        _COMPRESSION.encode(),
        len(compressed),
    )
    return [head, compressed], len(compressed), len(content)


def _message_indexes(stream: MessageStream, rows: slice) -> Iterator[tuple[int, bytes]]:
    """Yield each channel with messages in these rows, and its MessageIndex record."""
    times, sizes = stream.times[rows], stream.sizes[rows]
    offsets = stream.offsets[rows] - stream.offsets[rows.start, 0]
    for column in range(sizes.shape[1]):
        used = np.flatnonzero(sizes[:, column])
        if len(used):
            entries = np.empty((len(used), 2), "<u8")
            entries[:, 0] = times[used]
            entries[:, 1] = offsets[used, column]
            length = len(used) * _ENTRY_SIZE
            channel = column + 1
            head = INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, 6 + length, channel, length)
            yield channel, head + entries.tobytes()
