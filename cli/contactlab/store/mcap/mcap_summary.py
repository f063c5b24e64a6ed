"""The MCAP records that differ from file to file, as bytes.

Source of the layouts: https://mcap.dev/spec
"""

import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Attachment, AttachmentIndex, Channel, Header, McapRecord, Schema
from mcap.writer import MCAP0_MAGIC

COMPRESSION = "zstd"

_FRAME = struct.Struct("<BQ")
_STATISTICS = struct.Struct("<BQQHIIIIQQI")
_CHUNK_INDEX = struct.Struct("<BQQQQQI")
_CHUNK_INDEX_END = struct.Struct(f"<QI{len(COMPRESSION)}sQQ")
_SUMMARY_OFFSET = struct.Struct("<BQBQQ")
_METADATA_INDEX = struct.Struct("<BQQQ")
_DATA_END = struct.Struct("<BQI")


@dataclass(frozen=True)
class ChunkEntry:
    """What the summary says of a chunk.

    Attributes:
        span: log time of its first and of its last message [ns].
        start: where its record starts in the file.
        length: of that record.
        indexes: where the message index of each channel starts.
        indexes_length: of all its message indexes.
        compressed: length of its content as stored.
        uncompressed: and as it was.
    """

    span: tuple[int, int]
    start: int
    length: int
    indexes: Mapping[int, int]
    indexes_length: int
    compressed: int
    uncompressed: int

    @property
    def end(self) -> int:
        """Where its last message index ends."""
        return self.start + self.length + self.indexes_length


@dataclass(frozen=True)
class MessageCounts:
    """What the summary counts besides chunks; files have one attachment and one metadata record.

    Attributes:
        schemas: schemas in the file.
        messages: by channel id, for all channels.
    """

    schemas: int
    messages: Mapping[int, int]


def chunk_index(entry: ChunkEntry) -> bytes:
    """Return a ChunkIndex record."""
    offsets = _numbers(entry.indexes)
    fields = _CHUNK_INDEX.size + len(offsets) + _CHUNK_INDEX_END.size - _FRAME.size
    place = entry.start, entry.length
    return (
        _CHUNK_INDEX.pack(Opcode.CHUNK_INDEX, fields, *entry.span, *place, len(offsets))
        + offsets
        + _CHUNK_INDEX_END.pack(
            entry.indexes_length,
            len(COMPRESSION),
            COMPRESSION.encode(),
            entry.compressed,
            entry.uncompressed,
        )
    )


def statistics(counts: MessageCounts, chunks: Sequence[ChunkEntry]) -> bytes:
    """Return a Statistics record."""
    messages = _numbers(counts.messages)
    return (
        _STATISTICS.pack(
            Opcode.STATISTICS,
            _STATISTICS.size + len(messages) - _FRAME.size,
            sum(counts.messages.values()),
            counts.schemas,
            len(counts.messages),
            1,
            1,
            len(chunks),
            chunks[0].span[0],
            chunks[-1].span[1],
            len(messages),
        )
        + messages
    )


def metadata(name: str, entries: Mapping[str, str]) -> bytes:
    """Return a Metadata record."""
    pairs = b"".join(_text(key) + _text(value) for key, value in entries.items())
    body = _text(name) + len(pairs).to_bytes(4, "little") + pairs
    return _FRAME.pack(Opcode.METADATA, len(body)) + body


def metadata_index(name: str, offset: int, length: int) -> bytes:
    """Return a MetadataIndex record."""
    text = _text(name)
    fields = _METADATA_INDEX.size + len(text) - _FRAME.size
    return _METADATA_INDEX.pack(Opcode.METADATA_INDEX, fields, offset, length) + text


def summary_offset(opcode: int, start: int, length: int) -> bytes:
    """Return a SummaryOffset record."""
    fields = _SUMMARY_OFFSET.size - _FRAME.size
    return _SUMMARY_OFFSET.pack(Opcode.SUMMARY_OFFSET, fields, opcode, start, length)


def data_end(crc: int) -> bytes:
    """Return a DataEnd record."""
    return _DATA_END.pack(Opcode.DATA_END, _DATA_END.size - _FRAME.size, crc)


def _numbers(by_id: Mapping[int, int]) -> bytes:
    return b"".join(struct.pack("<HQ", key, value) for key, value in by_id.items())


def _text(text: str) -> bytes:
    content = text.encode()
    return len(content).to_bytes(4, "little") + content


LIBRARY = "contactlab"

_FOOTER = struct.Struct("<BQQQ")


@dataclass(frozen=True)
class FilePrefix:
    """The start of a file up to its metadata, which the runs of one scene have in common.

    Attributes:
        data: the bytes.
        crc: their CRC-32.
        topics: those of the channels 1, 2, ...
        schema_count: number of schemas.
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
    """The start of a file, up to its first chunk.

    Attributes:
        prefix: what comes first.
        metadata: the Metadata record.
        metadata_index: its entry for the summary.
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
    entry = AttachmentIndex(
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
        attachment=_encoded(entry),
    )


def file_head(start: FilePrefix, name: str, entries: Mapping[str, str]) -> FileHead:
    """Return the start of a file with its metadata."""
    record = metadata(name, entries)
    return FileHead(start, record, metadata_index(name, len(start.data), len(record)))


def file_tail(
    start: FileHead, chunks: Sequence[ChunkEntry], counts: Sequence[int], crc: int
) -> bytes:
    """Return the end of a file: the data section's end, the summary, the footer.

    Args:
        start: the start of the file.
        chunks: the summary's entry for each chunk; there is at least one.
        counts: messages of the channels 1, 2, ...
        crc: CRC-32 of all bytes before it.
    """
    counted = MessageCounts(start.prefix.schema_count, dict(enumerate(counts, start=1)))
    groups = (
        (Opcode.SCHEMA, start.prefix.schemas),
        (Opcode.CHANNEL, start.prefix.channels),
        (Opcode.STATISTICS, statistics(counted, chunks)),
        (Opcode.CHUNK_INDEX, b"".join(map(chunk_index, chunks))),
        (Opcode.ATTACHMENT_INDEX, start.prefix.attachment),
        (Opcode.METADATA_INDEX, start.metadata_index),
    )
    end = data_end(crc)
    position = summary_start = chunks[-1].end + len(end)
    offsets = b""
    for opcode, group in groups:
        offsets += summary_offset(opcode, position, len(group))
        position += len(group)
    summary = b"".join(group for _, group in groups) + offsets
    return end + summary + _footer(summary, summary_start, position)


def _footer(summary: bytes, summary_start: int, offsets_start: int) -> bytes:
    """Return the footer, whose CRC covers the summary and the footer's own first fields."""
    fields = _FOOTER.pack(Opcode.FOOTER, 20, summary_start, offsets_start)
    crc = zlib.crc32(fields, zlib.crc32(summary))
    return fields + crc.to_bytes(4, "little") + MCAP0_MAGIC


def _encoded(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for each in records:
        each.write(builder)
    return builder.end()
