"""A file's records as they lie in it, for the check; nothing here is shared with the writer."""

import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from io import BytesIO

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    Footer,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC

_MAGIC_SIZE = 8
_FOOTER_SIZE = 29
_FRAME = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQ")

_READERS: dict[int, Callable[[ReadDataStream], McapRecord]] = {
    Opcode.FOOTER: Footer.read,
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.CHUNK: Chunk.read,
    Opcode.MESSAGE_INDEX: MessageIndex.read,
    Opcode.CHUNK_INDEX: ChunkIndex.read,
    Opcode.ATTACHMENT: Attachment.read,
    Opcode.ATTACHMENT_INDEX: AttachmentIndex.read,
    Opcode.STATISTICS: Statistics.read,
    Opcode.METADATA: Metadata.read,
    Opcode.METADATA_INDEX: MetadataIndex.read,
    Opcode.SUMMARY_OFFSET: SummaryOffset.read,
}


@dataclass(frozen=True)
class RawRecord:
    """One record: where it starts, its kind and its content."""

    offset: int
    opcode: int
    body: bytes

    @property
    def length(self) -> int:
        """Length in the file, opcode and length included."""
        return _FRAME.size + len(self.body)

    @property
    def record(self) -> McapRecord | None:
        """The decoded record, or None where its kind has no reader."""
        read = _READERS.get(self.opcode)
        return read(ReadDataStream(BytesIO(self.body))) if read else None


@dataclass(frozen=True)
class ChunkRecords:
    """A chunk with what is in it and the message indexes that follow it.

    Attributes:
        frame: the Chunk record in the file.
        chunk: the same, decoded.
        sound: whether its content matches its checksum.
        messages: (log time, channel, offset in the content) of each message, as they lie.
        indexes: each message index and its offset in the file.
    """

    frame: RawRecord
    chunk: Chunk
    sound: bool
    messages: Sequence[tuple[int, int, int]]
    indexes: list[tuple[int, MessageIndex]] = field(default_factory=list[tuple[int, MessageIndex]])


@dataclass(frozen=True)
class FileRecords:
    """All records of a file.

    Attributes:
        chunks: the chunks, as they lie.
        data: records of the data section other than chunks and message indexes, also those within
            chunks other than messages.
        summary: records of the summary.
    """

    chunks: Sequence[ChunkRecords]
    data: Sequence[RawRecord]
    summary: Sequence[RawRecord]


def read_records(file: bytes) -> FileRecords:
    """Return the records of a file whose frame and checksums are in order.

    Raises:
        ValueError: a record runs over the end of what it lies in.
        Exception: of many classes, where a record's content is not as its kind demands.
    """
    chunks: list[ChunkRecords] = []
    data: list[RawRecord] = []
    [footer] = raw_records(file, len(file) - _MAGIC_SIZE - _FOOTER_SIZE, len(file) - _MAGIC_SIZE)
    summary_start = struct.unpack_from("<Q", footer.body)[0]
    for frame in raw_records(file, _MAGIC_SIZE, summary_start):
        record = frame.record
        if isinstance(record, Chunk):
            chunk, others = _chunk(frame, record)
            chunks.append(chunk)
            data += others
        elif isinstance(record, MessageIndex) and chunks:
            chunks[-1].indexes.append((frame.offset, record))
        else:
            data.append(frame)
    return FileRecords(chunks, data, list(raw_records(file, summary_start, footer.offset)))


def raw_records(data: bytes, start: int, stop: int) -> Iterator[RawRecord]:
    """Yield the records that lie one after the other from `start` to `stop`."""
    while start < stop:
        opcode, length = _FRAME.unpack_from(data, start)
        body = data[start + _FRAME.size : min(start + _FRAME.size + length, stop)]
        if len(body) != length:
            raise ValueError(f"the record at byte {start} runs over the end of its section")
        yield RawRecord(start, opcode, body)
        start += _FRAME.size + length


def _chunk(frame: RawRecord, chunk: Chunk) -> tuple[ChunkRecords, list[RawRecord]]:
    content = chunk.data
    if chunk.compression == "zstd":
        content = zstandard.decompress(content, chunk.uncompressed_size)
    elif chunk.compression:
        raise ValueError(f"compression '{chunk.compression}' is not one that is read here")
    messages: list[tuple[int, int, int]] = []
    others: list[RawRecord] = []
    for each in raw_records(content, 0, len(content)):
        if each.opcode == Opcode.MESSAGE:
            channel, _, log_time = _MESSAGE.unpack_from(each.body)
            messages.append((log_time, channel, each.offset))
        else:
            others.append(each)
    same = len(content) == chunk.uncompressed_size
    # Without a CRC, the compression's own checksum has been held against the content.
    sound = same and chunk.uncompressed_crc in (0, zlib.crc32(content))
    return ChunkRecords(frame, chunk, sound, messages), others


_FOOTER = struct.Struct("<BQQQI")
_DATA_END = struct.Struct("<BQI")
_SHORTEST = 2 * len(MCAP0_MAGIC) + _DATA_END.size + _FOOTER.size
_CRC_SIZE = 4


def find_damage(data: bytes) -> str | None:
    """Return what is wrong with a file's frame or checksums, in words; None if nothing is.

    The two checksums cover all bytes, so any flipped byte is found.
    """
    if len(data) < _SHORTEST or not data.startswith(MCAP0_MAGIC):
        return "this is no MCAP file"
    if not data.endswith(MCAP0_MAGIC):
        return "the file is cut short, or its end is damaged"
    end = len(data) - len(MCAP0_MAGIC)
    opcode, length, summary_start, _, summary_crc = _FOOTER.unpack_from(data, end - _FOOTER.size)
    if (opcode, length) != (Opcode.FOOTER, 20):
        return "the footer is damaged"
    if summary_start == 0:
        return "the summary is missing"
    return _data_damage(data, summary_start) or _summary_damage(
        data[summary_start : end - _CRC_SIZE], summary_crc
    )


def _data_damage(data: bytes, summary_start: int) -> str | None:
    data_end = summary_start - _DATA_END.size
    if not 0 <= data_end <= len(data) - _SHORTEST + len(MCAP0_MAGIC):
        return "the footer points outside the file"
    opcode, length, crc = _DATA_END.unpack_from(data, data_end)
    if (opcode, length) != (Opcode.DATA_END, _CRC_SIZE):
        return "the data section does not end right before the summary"
    if crc != zlib.crc32(memoryview(data)[:data_end]):
        return "the data section does not match its checksum"
    return None


def _summary_damage(summary: bytes, crc: int) -> str | None:
    return None if crc == zlib.crc32(summary) else "the summary does not match its checksum"
