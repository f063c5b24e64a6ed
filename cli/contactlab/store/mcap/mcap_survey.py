"""The records of an MCAP file with their offsets, for its check; independent of the writer."""

import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from io import BytesIO

import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk, McapRecord, MessageIndex
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC

UNREADABLE = (
    McapError,
    struct.error,
    zstandard.ZstdError,
    ValueError,
    LookupError,
    ArithmeticError,
    MemoryError,
)
"""What a file can raise that has its checksums, but is not ours."""
_FRAME = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQ")
_FOOTER = struct.Struct("<BQQQI")
_DATA_END = struct.Struct("<BQI")
_MIN_SIZE = 2 * len(MCAP0_MAGIC) + _DATA_END.size + _FOOTER.size
_CRC_SIZE = 4
_MOST_CHUNK = 64 << 20
"""Bytes that a chunk may hold: one that is written has 1 MiB, and as much as one step records."""


@dataclass(frozen=True)
class RawRecord:
    """A record as it is in the file."""

    offset: int  # where it starts, in the file or the chunk
    opcode: int  # its kind
    data: bytes  # its bytes, opcode and length included

    @property
    def body(self) -> bytes:
        """The bytes after opcode and length."""
        return self.data[_FRAME.size :]

    @cached_property
    def record(self) -> McapRecord:
        """The decoded record."""
        return next(StreamReader(BytesIO(self.data), skip_magic=True, emit_chunks=True).records)


@dataclass(frozen=True)
class ChunkRecords:
    """A chunk with its messages and the message indexes that follow it."""

    raw: RawRecord
    chunk: Chunk
    intact: bool  # whether its content matches its checksum
    # (log time, channel, offset in the content) of each message, in file order.
    messages: Sequence[tuple[int, int, int]]
    indexes: list[RawRecord] = field(default_factory=list[RawRecord])


@dataclass(frozen=True)
class FileRecords:
    """All records of a file."""

    chunks: Sequence[ChunkRecords]
    # Other records of the data section but message indexes, also those within chunks other than
    # messages.
    data: Sequence[RawRecord]
    summary: Sequence[RawRecord]


def find_damage(data: bytes) -> str | None:
    """Return what is wrong with a file's magic bytes or checksums; None if nothing is.

    The two checksums cover all bytes, so any flipped byte is found.
    """
    if len(data) < _MIN_SIZE or not data.startswith(MCAP0_MAGIC):
        return "this is no MCAP file"
    if not data.endswith(MCAP0_MAGIC):
        return "the file is truncated, or its end is damaged"
    end = len(data) - len(MCAP0_MAGIC)
    opcode, length, summary_start, _, summary_crc = _FOOTER.unpack_from(data, end - _FOOTER.size)
    if (opcode, length) != (Opcode.FOOTER, _FOOTER.size - _FRAME.size):
        return "the footer is damaged"
    if summary_start == 0:
        return "the summary is missing"
    if summary_crc != zlib.crc32(data[summary_start : end - _CRC_SIZE]):
        return "the summary does not match its checksum"
    return _find_data_damage(data, summary_start)


def _find_data_damage(data: bytes, summary_start: int) -> str | None:
    data_end = summary_start - _DATA_END.size
    if not 0 <= data_end <= len(data) - _MIN_SIZE + len(MCAP0_MAGIC):
        return "the footer points outside the file"
    opcode, length, crc = _DATA_END.unpack_from(data, data_end)
    if (opcode, length) != (Opcode.DATA_END, _CRC_SIZE):
        return "the data section does not end right before the summary"
    if crc != zlib.crc32(memoryview(data)[:data_end]):
        return "the data section does not match its checksum"
    return None


def read_records(data: bytes) -> FileRecords:
    """Return the records of a file in which `find_damage` finds none; see `UNREADABLE`."""
    chunks: list[ChunkRecords] = []
    others: list[RawRecord] = []
    footer = len(data) - len(MCAP0_MAGIC) - _FOOTER.size
    summary_start = _FOOTER.unpack_from(data, footer)[2]
    for raw in _raw_records(data, len(MCAP0_MAGIC), summary_start):
        record = raw.record
        if isinstance(record, Chunk):
            chunks.append(_read_chunk(raw, record, others))
        elif isinstance(record, MessageIndex) and chunks:
            chunks[-1].indexes.append(raw)
        else:
            others.append(raw)
    return FileRecords(chunks, others, list(_raw_records(data, summary_start, footer)))


def _raw_records(data: bytes, start: int, stop: int) -> Iterator[RawRecord]:
    """Yield the records from `start` to `stop`."""
    while start < stop:
        opcode, length = _FRAME.unpack_from(data, start)
        end = start + _FRAME.size + length
        if end > stop:
            raise ValueError(f"the record at byte {start} exceeds its section")
        yield RawRecord(start, opcode, data[start:end])
        start = end


def unpacked(compressed: bytes | memoryview, size: int) -> bytes:
    """Return the content of a chunk, whose size both the chunk and the compressed data state."""
    if size > _MOST_CHUNK or zstandard.frame_content_size(compressed) != size:
        raise ValueError(f"a chunk claims to hold {size:,} bytes")
    return zstandard.decompress(compressed)


def _read_chunk(raw: RawRecord, chunk: Chunk, others: list[RawRecord]) -> ChunkRecords:
    """Return a chunk with its messages, and add the other records of its content to others."""
    content = chunk.data
    if chunk.compression == "zstd":
        content = unpacked(content, chunk.uncompressed_size)
    elif chunk.compression:
        raise ValueError(f"compression '{chunk.compression}' is not supported")
    messages: list[tuple[int, int, int]] = []
    for each in _raw_records(content, 0, len(content)):
        if each.opcode == Opcode.MESSAGE:
            channel, _, log_time = _MESSAGE.unpack_from(each.body)
            messages.append((log_time, channel, each.offset))
        else:
            others.append(each)
    # Without a CRC, decompression has checked the content by the compression's own checksum.
    intact = chunk.uncompressed_crc in (0, zlib.crc32(content))
    intact = intact and len(content) == chunk.uncompressed_size
    return ChunkRecords(raw, chunk, intact, messages)
