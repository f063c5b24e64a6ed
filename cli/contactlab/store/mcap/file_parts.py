"""The parts of a trace file: its start, its chunks with their indexes, and its end.

Messages are interleaved in order of time, split into chunks and indexed by NumPy.
Source of the file's structure and of the record layouts: https://mcap.dev/spec
"""

import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise
from types import MappingProxyType

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

from contactlab.store.mcap.message_encoder import MessageGroup, Times
from contactlab.store.mcap.record_encoder import record_encoder, span_of
from contactlab.store.mcap.scratch import SCRATCH

CHUNK_SIZE = 1 << 20
_COMPRESSION = "zstd"

CHUNK_HEAD = struct.Struct(f"<BQQQQII{len(_COMPRESSION)}sQ")
# The content's checksum is zstd's own, which takes a tenth of the time and which decoders verify.
_NO_CRC = 0
_NOT_YET: Mapping[int, bytes] = MappingProxyType({})
_FRAME_SIZE = 9
LIBRARY = "contactlab"
_CRC_SIZE = 4
# Six of these in every file: by the library they would take a tenth of the time of a tiny run.
_SUMMARY_OFFSET = struct.Struct("<BQBQQ")


@dataclass(frozen=True)
class FileStart:
    """The start of a file, up to its metadata, which the runs of one scene share, or with it."""

    data: bytes
    crc: int  # CRC-32 of its bytes
    topics: tuple[str, ...]  # topics of the channels 1, 2, ...
    schemas: int  # how many there are
    # The records of the summary, by their kind and in its order; of messages there are none yet.
    summary: Mapping[Opcode, bytes]


def file_start(
    schemas: Sequence[Schema], channels: Sequence[Channel], attached: Attachment
) -> FileStart:
    """Return the start of a file without metadata; channels are numbered from 1."""
    repeated = {Opcode.SCHEMA: _encoded(*schemas), Opcode.CHANNEL: _encoded(*channels)}
    header = _encoded(Header(profile="", library=LIBRARY))
    before = MCAP0_MAGIC + header + b"".join(repeated.values())
    data = before + _encoded(attached)
    described = {name: value for name, value in vars(attached).items() if name != "data"}
    place = len(before), len(data) - len(before)
    index = AttachmentIndex(*place, data_size=len(attached.data), **described)
    topics = tuple(channel.topic for channel in channels)
    later = {Opcode.STATISTICS: b"", Opcode.CHUNK_INDEX: b""}
    summary = {**repeated, **later, Opcode.ATTACHMENT_INDEX: _encoded(index)}
    return FileStart(data, zlib.crc32(data), topics, len(schemas), summary)


def with_metadata(start: FileStart, name: str, entries: Mapping[str, str]) -> FileStart:
    """Return the start of a file with its metadata."""
    metadata = _encoded(Metadata(name, dict(entries)))
    index = MetadataIndex(offset=len(start.data), length=len(metadata), name=name)
    summary = {**start.summary, Opcode.METADATA_INDEX: _encoded(index)}
    crc = zlib.crc32(metadata, start.crc)
    return replace(start, data=start.data + metadata, crc=crc, summary=summary)


@dataclass(frozen=True)
class MessageStream:
    """The messages of a whole run, interleaved."""

    data: NDArray[np.uint8]  # (bytes,) Message records, ordered by state row, then by channel
    offsets: NDArray[np.int64]  # (rows, channels) where each record starts
    sizes: NDArray[np.int64]  # (rows, channels) its length; 0 where a channel has no message
    times: Times  # (rows,) log time [ns]

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
        sizes[span_of(group.rows), group.channel - 1] = group.size
    ends = np.cumsum(sizes)
    offsets = ends.reshape(sizes.shape) - sizes
    data = SCRATCH.take("stream", int(ends[-1]))
    for group in groups:
        group.write(data, offsets[span_of(group.rows), group.channel - 1])
    return MessageStream(data, offsets, sizes, times)


def encode_file(
    start: FileStart, stream: MessageStream, packed: Mapping[int, bytes] = _NOT_YET
) -> bytes:
    """Return a file.

    Its chunks may be packed already, each by its first row: another zstd may pack them otherwise.
    """
    parts, crc, position = [start.data], start.crc, len(start.data)
    chunks: list[ChunkIndex] = []
    cuts = [*packed, len(stream.times)] if packed else stream.cuts()
    for first, last in pairwise(cuts):
        chunk, index = _chunk(stream, slice(first, last), position, packed.get(first))
        parts += chunk
        chunks.append(index)
        position += index.chunk_length + index.message_index_length
    for part in parts[1:]:
        crc = zlib.crc32(part, crc)
    counts = np.count_nonzero(stream.sizes, axis=0).tolist()
    parts.append(_file_tail(start, chunks, counts, position, crc))
    return b"".join(parts)


def _chunk(
    stream: MessageStream, rows: slice, position: int, packed: bytes | None
) -> tuple[list[bytes], ChunkIndex]:
    """Return a chunk at a position in the file with its message indexes, and its own index."""
    stop = stream.offsets[rows.stop, 0] if rows.stop < len(stream.times) else len(stream.data)
    content = stream.data[stream.offsets[rows.start, 0] : stop].data
    compressed = packed or SCRATCH.compressor.compress(content)
    first, last = int(stream.times[rows.start]), int(stream.times[rows.stop - 1])
    length = CHUNK_HEAD.size + len(compressed)
    fields = length - _FRAME_SIZE, first, last, len(content), _NO_CRC
    name = _COMPRESSION.encode()
    head = CHUNK_HEAD.pack(Opcode.CHUNK, *fields, len(name), name, len(compressed))
    where = stream.times[rows], stream.sizes[rows], stream.offsets[rows]
    indexes, lengths = record_encoder().indexes(*where)
    starts = accumulate(lengths, initial=position + length)
    index = ChunkIndex(
        chunk_length=length,
        chunk_start_offset=position,
        compression=_COMPRESSION,
        compressed_size=len(compressed),
        message_end_time=last,
        message_index_length=len(indexes),
        message_index_offsets={
            channel: start
            for channel, (start, size) in enumerate(zip(starts, lengths, strict=False), start=1)
            if size
        },
        message_start_time=first,
        uncompressed_size=len(content),
    )
    return [head, compressed, indexes], index


def _file_tail(
    start: FileStart, chunks: Sequence[ChunkIndex], counts: Sequence[int], position: int, crc: int
) -> bytes:
    """Return the end of a file, at a position, given the CRC-32 of all bytes before it.

    It is the data section's end, the summary and the footer; there is at least one chunk.
    """
    statistics = Statistics(
        attachment_count=1,
        channel_count=len(counts),
        channel_message_counts=dict(enumerate(counts, start=1)),
        chunk_count=len(chunks),
        message_count=sum(counts),
        message_end_time=chunks[-1].message_end_time,
        message_start_time=chunks[0].message_start_time,
        metadata_count=1,
        schema_count=start.schemas,
    )
    found = {Opcode.STATISTICS: _encoded(statistics), Opcode.CHUNK_INDEX: _encoded(*chunks)}
    groups, data_end = {**start.summary, **found}, _encoded(DataEnd(crc))
    summary_start = position + len(data_end)
    summary = offsets = b""
    for kind, records in groups.items():
        group = summary_start + len(summary), len(records)
        offsets += _SUMMARY_OFFSET.pack(Opcode.SUMMARY_OFFSET, 17, kind, *group)
        summary += records
    footer = Footer(summary_start, summary_start + len(summary), 0)
    # The summary's CRC covers the footer's own first fields too.
    end = summary + offsets + _encoded(footer)[:-_CRC_SIZE]
    return data_end + end + zlib.crc32(end).to_bytes(_CRC_SIZE, "little") + MCAP0_MAGIC


def _encoded(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()
