"""Whether a trace file is sound: an inspection of its structure, apart from the writer.

Viewers rely on more than that messages can be read: they seek by the summary, the message indexes
and the statistics, and expect messages in the order of time.
"""

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
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from contactlab.store.mcap.check_chunk import chunk_entry, chunk_problems
from contactlab.store.mcap.integrity import damage
from contactlab.store.mcap.survey import Frame, Survey, survey

_Kind = TypeVar("_Kind", bound=McapRecord)

_UNREADABLE = (McapError, struct.error, zstandard.ZstdError, ValueError, LookupError)


def check_trace(path: Path) -> list[str]:
    """Return what is wrong with a trace file, in words; nothing if it is sound."""
    try:
        data = path.read_bytes()
    except OSError as error:
        return [f"cannot be read: {error.strerror}"]
    if problem := damage(data):
        return [problem]
    try:
        return list(_problems(survey(data)))
    except _UNREADABLE as error:
        return [f"a record cannot be decoded: {error}"]


def _problems(file: Survey) -> Iterator[str]:
    for chunk in file.chunks:
        where = f"chunk at byte {chunk.frame.offset}"
        yield from (f"{where}: {problem}" for problem in chunk_problems(chunk))
    yield from _order(file)
    yield from _definitions(file)
    yield from _summary_entries(file)
    yield from _statistics(file)
    yield from _attachments(file)
    yield from _groups(file)


def _order(file: Survey) -> Iterator[str]:
    if any(frame.opcode == Opcode.MESSAGE for frame in file.data):
        yield "a message lies outside of the chunks, where no index finds it"
    latest = 0
    for time in (time for chunk in file.chunks for time, _, _ in chunk.messages):
        if time < latest:
            yield f"a message of {time} ns lies after one of {latest} ns"
            return
        latest = time


def _definitions(file: Survey) -> Iterator[str]:
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


def _summary_entries(file: Survey) -> Iterator[str]:
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


def _statistics(file: Survey) -> Iterator[str]:
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


def _attachments(file: Survey) -> Iterator[str]:
    for frame in file.data:
        if frame.opcode == Opcode.ATTACHMENT:
            content, crc = frame.body[:-4], int.from_bytes(frame.body[-4:], "little")
            if zlib.crc32(content) != crc:
                yield f"attachment at byte {frame.offset} does not match its checksum"


def _groups(file: Survey) -> Iterator[str]:
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


def _of(frames: Iterable[Frame], kind: type[_Kind]) -> list[_Kind]:
    return [record for frame in frames if isinstance(record := frame.record, kind)]
