"""The parts of a trace file before and after its chunks.

Source of the file's structure: https://mcap.dev/spec
"""

import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

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

LIBRARY = "contactlab"
_CRC_SIZE = 4
# Six of these in every file: by the library they would take a tenth of the time of a tiny run.
_SUMMARY_OFFSET = struct.Struct("<BQBQQ")


@dataclass(frozen=True)
class FilePrefix:
    """The start of a file up to its metadata, which the runs of one scene share.

    Attributes:
        data: the bytes.
        crc: their CRC-32.
        topics: topics of the channels 1, 2, ...
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
    """The start of a file up to its first chunk.

    Attributes:
        prefix: the part that runs share.
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
