"""The parts of a trace file: its start, its chunks with their indexes, and its end.

NumPy interleaves messages in order of time, splits them into chunks and indexes them. Source of
the file's structure and of the record layouts: https://mcap.dev/spec
"""

import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, pairwise, starmap
from typing import NamedTuple

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Attachment, AttachmentIndex, Channel, Header, McapRecord, Schema
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from contactlab.store.mcap.encode_buffers import SCRATCH
from contactlab.store.mcap.message_encoder import MessageGroup, Times
from contactlab.store.mcap.record_encoder import ChunkIndexes, message_indexes

CHUNK_SIZE = 1 << 20
_COMPRESSION = "zstd"

CHUNK_HEAD = struct.Struct(f"<BQQQQII{len(_COMPRESSION)}sQ")
Compressed = bytes | memoryview
LIBRARY = "contactlab"
# Records of each file; encoding them by the library would take a tenth of the time of a tiny run.
FRAME = struct.Struct("<BQ")
DATA_END = struct.Struct("<BQI")
FOOTER = struct.Struct("<BQQQI")
_SUMMARY_OFFSET = struct.Struct("<BQBQQ")
_STATISTICS = struct.Struct("<QHIIIIQQ")
CHUNK_INDEX = struct.Struct("<QQQQ")
SIZES = struct.Struct("<QQ")
SIZE, _LENGTH, CHANNEL_NUMBER = map(struct.Struct, ("<I", "<Q", "<HQ"))


@dataclass(frozen=True)
class FileStart:
    """The start of a file, up to or including its metadata; runs of one scene share the former."""

    data: bytes
    crc: int  # CRC-32 of its bytes
    topics: tuple[str, ...]  # topics of the channels 1, 2, ...
    schemas: int  # number of schemas
    # The records of the summary, by their kind and in its order, without those of messages.
    summary: Mapping[Opcode, bytes]


def file_start(
    schemas: Sequence[Schema], channels: Sequence[Channel], attached: Attachment
) -> FileStart:
    """Return the start of a file without metadata; channels are numbered from 1."""
    repeated = {
        Opcode.SCHEMA: _encode_records(*schemas),
        Opcode.CHANNEL: _encode_records(*channels),
    }
    header = _encode_records(Header(profile="", library=LIBRARY))
    before = MCAP0_MAGIC + header + b"".join(repeated.values())
    data = before + _encode_records(attached)
    described = {name: value for name, value in vars(attached).items() if name != "data"}
    place = len(before), len(data) - len(before)
    index = AttachmentIndex(*place, data_size=len(attached.data), **described)
    topics = tuple(channel.topic for channel in channels)
    later = {Opcode.STATISTICS: b"", Opcode.CHUNK_INDEX: b""}
    summary = {**repeated, **later, Opcode.ATTACHMENT_INDEX: _encode_records(index)}
    return FileStart(data, zlib.crc32(data), topics, len(schemas), summary)


def with_metadata(start: FileStart, name: str, entries: Mapping[str, str]) -> FileStart:
    """Return the start of a file with its metadata."""
    content = b"".join(map(_encode_text, chain.from_iterable(entries.items())))
    metadata = _encode_record(Opcode.METADATA, _encode_text(name), _with_size(content))
    place = SIZES.pack(len(start.data), len(metadata))
    index = _encode_record(Opcode.METADATA_INDEX, place, _encode_text(name))
    summary = {**start.summary, Opcode.METADATA_INDEX: index}
    crc = zlib.crc32(metadata, start.crc)
    return replace(start, data=start.data + metadata, crc=crc, summary=summary)


class FramedChunk(NamedTuple):
    """A chunk with its message indexes."""

    parts: Sequence[Compressed]
    entry: bytes  # its record in the summary
    first: int  # time of its first message
    last: int  # time of its last message


@dataclass(frozen=True)
class MessageStream:
    """The messages of a whole run, interleaved."""

    data: NDArray[np.uint8]  # (bytes,) Message records, ordered by state row, then by channel
    offsets: NDArray[np.int64]  # (rows, channels) start of each record
    sizes: NDArray[np.int64]  # (rows, channels) its length; 0 if a channel has no message
    times: Times  # (rows,) log time [ns]

    def chunk_starts(self) -> list[int]:
        """Return the first row of each chunk, and the number of rows.

        Records of one row stay together; a row that crosses a multiple of CHUNK_SIZE ends its
        chunk.
        """
        block = self.offsets[:, 0] // CHUNK_SIZE
        return [0, *(np.flatnonzero(np.diff(block)) + 1).tolist(), len(block)]


def interleave_groups(groups: Sequence[MessageGroup], channels: int, times: Times) -> MessageStream:
    """Return the records of all groups in one buffer, valid until the next call."""
    sizes = np.zeros((len(times), channels), np.int64)
    for group in groups:
        sizes[group.rows, group.channels - 1] = group.size
    ends = np.cumsum(sizes)
    offsets = ends.reshape(sizes.shape) - sizes
    data = SCRATCH.take_buffer("stream", int(ends[-1]))
    for group in groups:
        group.write(data, offsets[group.rows, group.channels - 1])
    return MessageStream(data, offsets, sizes, times)


def encode_file(start: FileStart, stream: MessageStream) -> bytes:
    """Return a file; see `encode_parts`."""
    return b"".join(encode_parts(start, stream))


def encode_long_file(start: FileStart, stream: MessageStream) -> bytes:
    """Return a file as a view of an array, which lies on disk if arrays do; see `encode_parts`."""
    file, end = np.empty(len(stream.data) // 4, np.uint8), 0
    for part in encode_parts(start, stream):
        if end + len(part) > len(file):
            longer = np.empty(2 * (end + len(part)), np.uint8)
            longer[:end] = file[:end]
            file = longer
        file[end : end + len(part)] = np.frombuffer(part, np.uint8)
        end += len(part)
    return file[:end].data  # pyright: ignore[reportReturnType] - written and hashed like bytes


def encode_parts(start: FileStart, stream: MessageStream) -> Iterator[Compressed]:
    """Yield the parts of a file, one after the other."""
    yield start.data
    crc, position = start.crc, len(start.data)
    chunks: list[FramedChunk] = []
    cuts = stream.chunk_starts()
    places = [*stream.offsets[cuts[:-1], 0].tolist(), len(stream.data)]
    indexes = message_indexes(stream.times, stream.sizes, stream.offsets, cuts)
    for rows, (first, last), index in zip(pairwise(cuts), pairwise(places), indexes, strict=True):
        packed = SCRATCH.compressor.compress(stream.data[first:last].data)
        times = int(stream.times[rows[0]]), int(stream.times[rows[1] - 1])
        chunk = frame_chunk(packed, last - first, times, index, position)
        for part in chunk.parts:
            crc = zlib.crc32(part, crc)
            position += len(part)
            yield part
        chunks.append(chunk._replace(parts=()))
    counts = np.count_nonzero(stream.sizes, axis=0).tolist()
    yield encode_end(start, chunks, counts, crc, position)


def encode_end(
    start: FileStart, chunks: Sequence[FramedChunk], counts: Sequence[int], crc: int, position: int
) -> bytes:
    """Return the end of the data section, the summary and the footer.

    Args:
        start: the start of the file.
        chunks: its chunks.
        counts: number of messages by channel.
        crc: CRC-32 of all bytes before.
        position: number of these bytes.
    """
    ends = chunks[0].first, chunks[-1].last
    totals = sum(counts), start.schemas, len(counts), 1, 1, len(chunks)
    by_channel = _encode_by_channel(dict(enumerate(counts, start=1)))
    statistics = _encode_record(Opcode.STATISTICS, _STATISTICS.pack(*totals, *ends), by_channel)
    entries = b"".join(chunk.entry for chunk in chunks)
    groups = {**start.summary, Opcode.STATISTICS: statistics, Opcode.CHUNK_INDEX: entries}
    summary_start = position + DATA_END.size
    summary = offsets = b""
    for kind, records in groups.items():
        group = summary_start + len(summary), len(records)
        offsets += _SUMMARY_OFFSET.pack(Opcode.SUMMARY_OFFSET, 17, kind, *group)
        summary += records
    sections = summary_start, summary_start + len(summary)
    footer = FOOTER.pack(Opcode.FOOTER, FOOTER.size - FRAME.size, *sections, 0)
    # The summary's CRC covers the footer's own first fields too.
    end = summary + offsets + footer[: -SIZE.size]
    data_end = DATA_END.pack(Opcode.DATA_END, SIZE.size, crc)
    return data_end + end + SIZE.pack(zlib.crc32(end)) + MCAP0_MAGIC


def frame_chunk(
    packed: Compressed, size: int, times: tuple[int, int], index: ChunkIndexes, position: int
) -> FramedChunk:
    """Return a compressed chunk of `size` bytes in a file, with the times of its first and last."""
    length, name = CHUNK_HEAD.size + len(packed), _COMPRESSION.encode()
    # Zstd's own checksum covers the content: it takes a tenth of the time, and decoders verify it.
    no_checksum = 0
    described = size, no_checksum, len(name), name, len(packed)
    head = CHUNK_HEAD.pack(Opcode.CHUNK, length - FRAME.size, *times, *described)
    places = {channel: position + length + start for channel, start in index.starts.items()}
    entry = _encode_record(
        Opcode.CHUNK_INDEX,
        CHUNK_INDEX.pack(*times, position, length),
        _encode_by_channel(places),
        _LENGTH.pack(len(index.data)),
        _encode_text(_COMPRESSION),
        SIZES.pack(len(packed), size),
    )
    return FramedChunk([head, packed, index.data], entry, *times)


def _encode_record(kind: Opcode, *parts: bytes) -> bytes:
    return FRAME.pack(kind, sum(map(len, parts))) + b"".join(parts)


def _with_size(data: bytes) -> bytes:
    return SIZE.pack(len(data)) + data


def _encode_text(text: str) -> bytes:
    return _with_size(text.encode())


def _encode_by_channel(numbers: Mapping[int, int]) -> bytes:
    return _with_size(b"".join(starmap(CHANNEL_NUMBER.pack, numbers.items())))


def _encode_records(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()
