"""Whether a chunk's message indexes point at its messages."""

from collections import Counter
from collections.abc import Iterator

from mcap.records import ChunkIndex, MessageIndex

from contactlab.store.mcap.survey import SurveyedChunk

_INDEX_HEAD_SIZE = 15
_INDEX_ENTRY_SIZE = 16


def chunk_problems(chunk: SurveyedChunk) -> Iterator[str]:
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


def _missing_indexes(chunk: SurveyedChunk) -> Iterator[str]:
    spoken = {channel for _, channel, _ in chunk.messages}
    indexed = Counter(index.channel_id for _, index in chunk.indexes)
    for channel in sorted(spoken - indexed.keys()):
        yield f"channel {channel} has messages but no message index"
    for channel, count in sorted(indexed.items()):
        if count > 1:
            yield f"channel {channel} has {count} message indexes"


def _index_problems(chunk: SurveyedChunk, index: MessageIndex) -> Iterator[str]:
    found = [
        (time, offset) for time, channel, offset in chunk.messages if channel == index.channel_id
    ]
    if not found:
        yield f"channel {index.channel_id} has a message index but no messages"
    elif sorted(index.records) != sorted(found):
        yield f"the message index of channel {index.channel_id} does not point at its messages"


def chunk_entry(chunk: SurveyedChunk) -> ChunkIndex:
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
