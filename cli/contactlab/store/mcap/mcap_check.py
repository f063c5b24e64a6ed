"""Whether a chunk's message indexes point at its messages."""

import struct
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import groupby
from pathlib import Path
from typing import TypeVar

import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from contactlab.store.mcap.mcap_survey import (
    ChunkRecords,
    FileRecords,
    RawRecord,
    find_damage,
    read_records,
)

_INDEX_HEAD_SIZE = 15
_INDEX_ENTRY_SIZE = 16


def chunk_problems(chunk: ChunkRecords) -> Iterator[str]:
    """Yield what is wrong within a chunk and its message indexes."""
    if not chunk.sound:
        yield "its content does not match its checksum"
    times = [time for time, _, _ in chunk.messages]
    span = (min(times), max(times)) if times else (0, 0)
    if span != (chunk.chunk.message_start_time, chunk.chunk.message_end_time):
        yield "its time span is not that of its messages"
    yield from _missing_indexes(chunk)
    for _, index in chunk.indexes:
        yield from _index_problems(chunk, index)


def _missing_indexes(chunk: ChunkRecords) -> Iterator[str]:
    spoken = {channel for _, channel, _ in chunk.messages}
    indexed = Counter(index.channel_id for _, index in chunk.indexes)
    for channel in sorted(spoken - indexed.keys()):
        yield f"channel {channel} has messages but no message index"
    for channel, count in sorted(indexed.items()):
        if count > 1:
            yield f"channel {channel} has {count} message indexes"


def _index_problems(chunk: ChunkRecords, index: MessageIndex) -> Iterator[str]:
    found = [
        (time, offset) for time, channel, offset in chunk.messages if channel == index.channel_id
    ]
    if not found:
        yield f"channel {index.channel_id} has a message index but no messages"
    elif sorted(index.records) != sorted(found):
        yield f"the message index of channel {index.channel_id} does not point at its messages"


def chunk_entry(chunk: ChunkRecords) -> ChunkIndex:
    """Return what the summary should say of a chunk."""
    record = chunk.chunk
    entries = sum(len(index.records) for _, index in chunk.indexes)
    return ChunkIndex(
        chunk_length=chunk.frame.length,
        chunk_start_offset=chunk.frame.offset,
        compression=record.compression,
        compressed_size=len(record.data),
        message_end_time=record.message_end_time,
        message_index_length=len(chunk.indexes) * _INDEX_HEAD_SIZE + entries * _INDEX_ENTRY_SIZE,
        message_index_offsets={index.channel_id: offset for offset, index in chunk.indexes},
        message_start_time=record.message_start_time,
        uncompressed_size=record.uncompressed_size,
    )


_Kind = TypeVar("_Kind", bound=McapRecord)

_UNREADABLE = (McapError, struct.error, zstandard.ZstdError, ValueError, LookupError)


def check_trace(path: Path) -> list[str]:
    """Return what is wrong with a trace file, in words; nothing if it is sound."""
    try:
        data = path.read_bytes()
    except OSError as error:
        return [f"cannot be read: {error.strerror}"]
    if problem := find_damage(data):
        return [problem]
    try:
        return list(_problems(read_records(data)))
    except _UNREADABLE as error:
        return [f"a record cannot be decoded: {error}"]


def _problems(file: FileRecords) -> Iterator[str]:
    for chunk in file.chunks:
        where = f"chunk at byte {chunk.frame.offset}"
        yield from (f"{where}: {problem}" for problem in chunk_problems(chunk))
    yield from _order(file)
    yield from _definitions(file)
    yield from _summary_entries(file)
    yield from _statistics(file)
    yield from _attachments(file)
    yield from _groups(file)


def _order(file: FileRecords) -> Iterator[str]:
    if any(frame.opcode == Opcode.MESSAGE for frame in file.data):
        yield "a message lies outside of the chunks, where no index finds it"
    latest = 0
    for time in (time for chunk in file.chunks for time, _, _ in chunk.messages):
        if time < latest:
            yield f"a message of {time} ns lies after one of {latest} ns"
            return
        latest = time


def _definitions(file: FileRecords) -> Iterator[str]:
    schemas = {record.id: record for record in _of(file.data, Schema)}
    channels = {record.id: record for record in _of(file.data, Channel)}
    if schemas != {record.id: record for record in _of(file.summary, Schema)}:
        yield "the summary's schemas are not those of the data section"
    if channels != {record.id: record for record in _of(file.summary, Channel)}:
        yield "the summary's channels are not those of the data section"
    for channel in channels.values():
        if channel.schema_id not in schemas:
            yield f"channel {channel.topic} has no schema"
    spoken = {channel for chunk in file.chunks for _, channel, _ in chunk.messages}
    for number in sorted(spoken - set(channels)):
        yield f"channel {number} has messages but no definition"


def _summary_entries(file: FileRecords) -> Iterator[str]:
    """Compare what the summary points at with what lies there."""
    chunks = [chunk_entry(chunk) for chunk in file.chunks]
    attachments = [
        AttachmentIndex(
            offset=frame.offset,
            length=frame.length,
            log_time=record.log_time,
            create_time=record.create_time,
            data_size=len(record.data),
            name=record.name,
            media_type=record.media_type,
        )
        for frame in file.data
        if isinstance(record := frame.record, Attachment)
    ]
    metadata = [
        MetadataIndex(offset=frame.offset, length=frame.length, name=record.name)
        for frame in file.data
        if isinstance(record := frame.record, Metadata)
    ]
    for kind, expected in (
        (ChunkIndex, chunks),
        (AttachmentIndex, attachments),
        (MetadataIndex, metadata),
    ):
        if _of(file.summary, kind) != expected:
            yield f"the summary's {kind.__name__} records do not match the data section"


def _statistics(file: FileRecords) -> Iterator[str]:
    stored = _of(file.summary, Statistics)
    if len(stored) != 1:
        yield f"the summary has {len(stored)} Statistics records but should have one"
        return
    messages = [message for chunk in file.chunks for message in chunk.messages]
    times = [time for time, _, _ in messages] or [0]
    expected = Statistics(
        attachment_count=len(_of(file.data, Attachment)),
        channel_count=len({record.id for record in _of(file.data, Channel)}),
        channel_message_counts=dict(Counter(channel for _, channel, _ in messages)),
        chunk_count=len(file.chunks),
        message_count=len(messages),
        message_end_time=max(times),
        message_start_time=min(times),
        metadata_count=len(_of(file.data, Metadata)),
        schema_count=len({record.id for record in _of(file.data, Schema)}),
    )
    for name, value in vars(expected).items():
        found = vars(stored[0])[name]
        if name == "channel_message_counts":
            found = {channel: count for channel, count in found.items() if count}
        if found != value:
            yield f"the statistics say {name} is {found}, but it is {value}"


def _attachments(file: FileRecords) -> Iterator[str]:
    for frame in file.data:
        if frame.opcode == Opcode.ATTACHMENT:
            content, crc = frame.body[:-4], int.from_bytes(frame.body[-4:], "little")
            if zlib.crc32(content) != crc:
                yield f"attachment at byte {frame.offset} does not match its checksum"


def _groups(file: FileRecords) -> Iterator[str]:
    """Compare the summary offsets with the groups of equal records in the summary."""
    expected: list[SummaryOffset] = []
    for opcode, group in groupby(file.summary, key=lambda frame: frame.opcode):
        frames = list(group)
        length = sum(frame.length for frame in frames)
        expected.append(SummaryOffset(opcode, frames[0].offset, length))
    expected = [each for each in expected if each.group_opcode != Opcode.SUMMARY_OFFSET]
    stored = [each for each in _of(file.summary, SummaryOffset) if each.group_length]
    if stored != expected:
        yield "the summary offsets do not point at the summary's groups"


def _of(frames: Iterable[RawRecord], kind: type[_Kind]) -> list[_Kind]:
    return [record for frame in frames if isinstance(record := frame.record, kind)]
