"""What stands before and after the chunks of a trace file.

Source of the file's structure: https://mcap.dev/spec
"""

import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Attachment, AttachmentIndex, Channel, Header, McapRecord, Schema
from mcap.writer import MCAP0_MAGIC

from contactlab.store.mcap.records import (
    ChunkEntry,
    Counts,
    chunk_index,
    data_end,
    metadata,
    metadata_index,
    statistics,
    summary_offset,
)

LIBRARY = "contactlab"

_FOOTER = struct.Struct("<BQQQ")


@dataclass(frozen=True)
class Opening:
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
class Head:
    """The start of a file, up to its first chunk.

    Attributes:
        opening: what comes first.
        metadata: the Metadata record.
        metadata_index: its entry for the summary.
    """

    opening: Opening
    metadata: bytes
    metadata_index: bytes

    @property
    def data(self) -> bytes:
        """The bytes."""
        return self.opening.data + self.metadata

    @property
    def crc(self) -> int:
        """Their CRC-32."""
        return zlib.crc32(self.metadata, self.opening.crc)


def opening(
    schemas: Sequence[Schema], channels: Sequence[Channel], attachment: Attachment
) -> Opening:
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
    return Opening(
        data=before + attached,
        crc=zlib.crc32(before + attached),
        topics=tuple(channel.topic for channel in channels),
        schema_count=len(schemas),
        schemas=schema_records,
        channels=channel_records,
        attachment=_encoded(entry),
    )


def head(start: Opening, name: str, entries: Mapping[str, str]) -> Head:
    """Return the start of a file with its metadata."""
    record = metadata(name, entries)
    return Head(start, record, metadata_index(name, len(start.data), len(record)))


def tail(start: Head, chunks: Sequence[ChunkEntry], counts: Sequence[int], crc: int) -> bytes:
    """Return the end of a file: the data section's end, the summary, the footer.

    Args:
        start: the start of the file.
        chunks: the summary's entry for each chunk; there is at least one.
        counts: messages of the channels 1, 2, ...
        crc: CRC-32 of all bytes before it.
    """
    counted = Counts(start.opening.schema_count, dict(enumerate(counts, start=1)))
    groups = (
        (Opcode.SCHEMA, start.opening.schemas),
        (Opcode.CHANNEL, start.opening.channels),
        (Opcode.STATISTICS, statistics(counted, chunks)),
        (Opcode.CHUNK_INDEX, b"".join(map(chunk_index, chunks))),
        (Opcode.ATTACHMENT_INDEX, start.opening.attachment),
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
