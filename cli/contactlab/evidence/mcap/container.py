"""What stands before and after the chunks of a trace file.

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
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC

LIBRARY = "contactlab"

_FOOTER = struct.Struct("<BQQQ")


@dataclass(frozen=True)
class Head:
    """The start of a file, and the summary records that point into it."""

    data: bytes
    schemas: Sequence[Schema]
    channels: Sequence[Channel]
    attachment: AttachmentIndex
    metadata: MetadataIndex


def head(
    schemas: Sequence[Schema],
    channels: Sequence[Channel],
    attachment: Attachment,
    metadata: Metadata,
) -> Head:
    """Return the start of a file, up to its first chunk."""
    builder = RecordBuilder()
    builder.write(MCAP0_MAGIC)
    for each in (Header(profile="", library=LIBRARY), *schemas, *channels):
        each.write(builder)
    attachment_offset = builder.count
    attachment.write(builder)
    metadata_offset = builder.count
    metadata.write(builder)
    attachment_index = AttachmentIndex(
        offset=attachment_offset,
        length=metadata_offset - attachment_offset,
        log_time=attachment.log_time,
        create_time=attachment.create_time,
        data_size=len(attachment.data),
        name=attachment.name,
        media_type=attachment.media_type,
    )
    metadata_index = MetadataIndex(
        offset=metadata_offset, length=builder.count - metadata_offset, name=metadata.name
    )
    return Head(builder.end(), schemas, channels, attachment_index, metadata_index)


def statistics(start: Head, chunks: Sequence[ChunkIndex], counts: Mapping[int, int]) -> Statistics:
    """Return the counts of a file, given its messages by channel id."""
    return Statistics(
        attachment_count=1,
        channel_count=len(start.channels),
        channel_message_counts=dict(counts),
        chunk_count=len(chunks),
        message_count=sum(counts.values()),
        message_end_time=chunks[-1].message_end_time,
        message_start_time=chunks[0].message_start_time,
        metadata_count=1,
        schema_count=len(start.schemas),
    )


def tail(
    start: Head, chunks: Sequence[ChunkIndex], counts: Mapping[int, int], position: int, crc: int
) -> bytes:
    """Return the end of a file: the data section's end, the summary, the footer.

    Args:
        start: the start of the file.
        chunks: the summary's entry for each chunk.
        counts: messages by channel id.
        position: where the tail starts in the file.
        crc: CRC-32 of all bytes before it.
    """
    builder = RecordBuilder()
    DataEnd(crc).write(builder)
    summary_start = builder.count
    groups: tuple[tuple[Opcode, Sequence[McapRecord]], ...] = (
        (Opcode.SCHEMA, start.schemas),
        (Opcode.CHANNEL, start.channels),
        (Opcode.STATISTICS, [statistics(start, chunks, counts)]),
        (Opcode.CHUNK_INDEX, chunks),
        (Opcode.ATTACHMENT_INDEX, [start.attachment]),
        (Opcode.METADATA_INDEX, [start.metadata]),
    )
    offsets: list[SummaryOffset] = []
    for opcode, records in groups:
        group_start = builder.count
        for each in records:
            each.write(builder)
        offsets.append(SummaryOffset(opcode, position + group_start, builder.count - group_start))
    offsets_start = builder.count
    for each in offsets:
        each.write(builder)
    data = builder.end()
    return data + _footer(data[summary_start:], position + summary_start, position + offsets_start)


def _footer(summary: bytes, summary_start: int, offsets_start: int) -> bytes:
    """Return the footer, whose CRC covers the summary and the footer's own first fields."""
    fields = _FOOTER.pack(Opcode.FOOTER, 20, summary_start, offsets_start)
    builder = RecordBuilder()
    Footer(summary_start, offsets_start, zlib.crc32(fields, zlib.crc32(summary))).write(builder)
    return builder.end() + MCAP0_MAGIC
