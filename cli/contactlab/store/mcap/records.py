"""The MCAP records that differ from file to file, as bytes.

Source of the layouts: https://mcap.dev/spec
"""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mcap.opcode import Opcode

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
class Counts:
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


def statistics(counts: Counts, chunks: Sequence[ChunkEntry]) -> bytes:
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
