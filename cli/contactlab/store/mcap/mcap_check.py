"""Check a trace file: its structure, independently of the writer, and its record.

Viewers rely on more than readable messages: they seek by the summary, the message indexes and the
statistics, and expect messages in order of time.
"""

import json
import zlib
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Iterator
from itertools import groupby
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
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

from contactlab.contact.trace_arrays import hash_of_states
from contactlab.errors import StoreError
from contactlab.schema.evidence import EvidenceRecord, TraceFile
from contactlab.store.atomic_files import sha256_of
from contactlab.store.mcap.mcap_survey import (
    UNREADABLE,
    ChunkRecords,
    FileRecords,
    RawRecord,
    find_damage,
    read_records,
)
from contactlab.store.mcap.trace_messages import EVIDENCE_TOPIC, STATE_TOPIC, contacts_topic
from contactlab.store.mcap.trace_reader import ACTIVATIONS, StoredTrace, read_trace

_Record = TypeVar("_Record", bound=McapRecord)

_CRC_SIZE = 4
# What a record has only once its trace is written; so that equal runs have equal traces.
_LATER = ("trace", "cost", "started", "finished", "accuracy", "timing")


def check_trace(path: Path) -> list[str]:
    """Return the defects of a trace file; none if it is sound."""
    try:
        data = path.read_bytes()
    except OSError as error:
        return [f"cannot be read: {error.strerror}"]
    if damage := find_damage(data):
        return [damage]
    try:
        return list(_find_problems(read_records(data)))
    except UNREADABLE as error:
        return [f"a record cannot be decoded: {error}"]


def _find_problems(file: FileRecords) -> Iterator[str]:
    for chunk in file.chunks:
        where = f"chunk at byte {chunk.raw.offset}"
        yield from (f"{where}: {problem}" for problem in _check_chunk(chunk))
    yield from _check_order(file)
    yield from _check_definitions(file)
    yield from _check_indexes(file)
    yield from _check_statistics(file)
    yield from _check_attachments(file)
    yield from _check_summary_offsets(file)


def _check_chunk(chunk: ChunkRecords) -> Iterator[str]:
    if not chunk.intact:
        yield "its content does not match its checksum"
    if _span(chunk.messages) != (chunk.chunk.message_start_time, chunk.chunk.message_end_time):
        yield "its time span is not that of its messages"
    messages: defaultdict[int, list[tuple[int, int]]] = defaultdict(list)
    for time, channel, offset in chunk.messages:
        messages[channel].append((time, offset))
    indexed = {each.channel_id: each.records for each in _of(chunk.indexes, MessageIndex)}
    if len(indexed) < len(chunk.indexes):
        yield "a channel has two message indexes"
    for channel in sorted(messages.keys() | indexed.keys()):
        if channel not in indexed:
            yield f"channel {channel} has messages but no message index"
        elif sorted(indexed[channel]) != sorted(messages[channel]):
            yield f"the message index of channel {channel} does not point at its messages"


def _span(messages: Collection[tuple[int, int, int]]) -> tuple[int, int]:
    """Return the first and the last log time; zeros if there is no message."""
    times = [time for time, _, _ in messages] or [0]
    return min(times), max(times)


def _check_order(file: FileRecords) -> Iterator[str]:
    if any(raw.opcode == Opcode.MESSAGE for raw in file.data):
        yield "a message lies outside of the chunks, where no index finds it"
    latest = 0
    for time in (time for chunk in file.chunks for time, _, _ in chunk.messages):
        if time < latest:
            yield f"a message of {time} ns lies after one of {latest} ns"
            return
        latest = time


def _check_definitions(file: FileRecords) -> Iterator[str]:
    schemas = {record.id: record for record in _of(file.data, Schema)}
    channels = {record.id: record for record in _of(file.data, Channel)}
    if schemas != {record.id: record for record in _of(file.summary, Schema)}:
        yield "the summary's schemas are not those of the data section"
    if channels != {record.id: record for record in _of(file.summary, Channel)}:
        yield "the summary's channels are not those of the data section"
    for channel in channels.values():
        if channel.schema_id not in schemas:
            yield f"channel {channel.topic} has no schema"
    used = {channel for chunk in file.chunks for _, channel, _ in chunk.messages}
    for number in sorted(used - set(channels)):
        yield f"channel {number} has messages but no definition"


def _check_indexes(file: FileRecords) -> Iterator[str]:
    """Compare the summary's indexes with the records that they point at."""
    expected: dict[type[McapRecord], list[McapRecord]] = {
        ChunkIndex: [_chunk_index(chunk) for chunk in file.chunks],
        AttachmentIndex: [],
        MetadataIndex: [],
    }
    for raw in file.data:
        offset, length, record = raw.offset, len(raw.data), raw.record
        if isinstance(record, Attachment):
            described = {name: each for name, each in vars(record).items() if name != "data"}
            index = AttachmentIndex(offset, length, data_size=len(record.data), **described)
            expected[AttachmentIndex].append(index)
        elif isinstance(record, Metadata):
            expected[MetadataIndex].append(MetadataIndex(offset, length, record.name))
    for kind, records in expected.items():
        if _of(file.summary, kind) != records:
            yield f"the summary's {kind.__name__} records do not match the data section"


def _chunk_index(chunk: ChunkRecords) -> ChunkIndex:
    record, offsets = chunk.chunk, [raw.offset for raw in chunk.indexes]
    channels = [index.channel_id for index in _of(chunk.indexes, MessageIndex)]
    return ChunkIndex(
        chunk_length=len(chunk.raw.data),
        chunk_start_offset=chunk.raw.offset,
        compression=record.compression,
        compressed_size=len(record.data),
        message_end_time=record.message_end_time,
        message_index_length=sum(len(raw.data) for raw in chunk.indexes),
        message_index_offsets=dict(zip(channels, offsets, strict=True)),
        message_start_time=record.message_start_time,
        uncompressed_size=record.uncompressed_size,
    )


def _check_statistics(file: FileRecords) -> Iterator[str]:
    stored = _of(file.summary, Statistics)
    if len(stored) != 1:
        yield f"the summary has {len(stored)} Statistics records but should have one"
        return
    messages = [message for chunk in file.chunks for message in chunk.messages]
    start, end = _span(messages)
    expected = Statistics(
        attachment_count=len(_of(file.data, Attachment)),
        channel_count=len({record.id for record in _of(file.data, Channel)}),
        channel_message_counts=dict(Counter(channel for _, channel, _ in messages)),
        chunk_count=len(file.chunks),
        message_count=len(messages),
        message_end_time=end,
        message_start_time=start,
        metadata_count=len(_of(file.data, Metadata)),
        schema_count=len({record.id for record in _of(file.data, Schema)}),
    )
    for name, value in vars(expected).items():
        found = vars(stored[0])[name]
        if name == "channel_message_counts":
            found = {channel: count for channel, count in found.items() if count}
        if found != value:
            yield f"the statistics say {name} is {found}, but it is {value}"


def _check_attachments(file: FileRecords) -> Iterator[str]:
    for raw in file.data:
        if raw.opcode == Opcode.ATTACHMENT:
            content, crc = raw.body[:-_CRC_SIZE], int.from_bytes(raw.body[-_CRC_SIZE:], "little")
            if zlib.crc32(content) != crc:
                yield f"attachment at byte {raw.offset} does not match its checksum"


def _check_summary_offsets(file: FileRecords) -> Iterator[str]:
    """Compare the summary offsets with the groups of equal records in the summary."""
    expected: list[SummaryOffset] = []
    for opcode, group in groupby(file.summary, key=lambda raw: raw.opcode):
        records = list(group)
        length = sum(len(raw.data) for raw in records)
        expected.append(SummaryOffset(opcode, records[0].offset, length))
    expected = [each for each in expected if each.group_opcode != Opcode.SUMMARY_OFFSET]
    stored = [each for each in _of(file.summary, SummaryOffset) if each.group_length]
    if stored != expected:
        yield "the summary offsets do not point at the summary's groups"


def _of(records: Iterable[RawRecord], kind: type[_Record]) -> list[_Record]:
    return [record for raw in records if isinstance(record := raw.record, kind)]


def trace_problems(
    path: Path, record: EvidenceRecord, model: bytes | None = None, but: Collection[str] = ()
) -> Iterator[str]:
    """Yield how a trace's file and its record contradict each other, but for some fields.

    The scene's model file, where given, is compared with the model that the trace holds.
    """
    assert record.trace is not None
    if (path.stat().st_size, sha256_of(path)) != (record.trace.bytes, record.trace.sha256):
        yield "changed since it was written"
        return
    if problems := check_trace(path):
        yield from problems
        return
    try:
        trace = read_trace(path, path.name)
        yield from _contradictions(trace, record, but)
        yield from _wrong_counts(trace, record, record.trace)
    except (StoreError, ValueError) as error:
        yield str(error)
        return
    if model is not None and trace.model_xml != model:
        yield "its model is not the scene's"


def _contradictions(
    trace: StoredTrace, record: EvidenceRecord, but: Collection[str]
) -> Iterator[str]:
    inside = _plain(EvidenceRecord.model_validate_json(trace.record_json))
    for name, value in _plain(record).items():
        # Errors have a tolerance too, which is judged after the trace is written.
        is_later = name == "tolerances_met" and record.accuracy is not None
        if inside[name] != value and name not in but and not is_later:
            yield f"its record has another {name} than the table"
    states = np.column_stack((trace.time, trace.qpos, trace.qvel))
    # The hash is of the activations too, which the trace has not.
    if trace.metadata.get(ACTIVATIONS) == "0" and hash_of_states(states) != record.trajectory_hash:
        yield "its states do not give the trajectory's hash"


def _plain(record: EvidenceRecord) -> dict[str, Any]:
    content = json.loads(record.model_dump_json(exclude=set(_LATER)))
    # The table has one column of settings for all runs, with nulls for those of other runs.
    content["settings"] = {name: v for name, v in content["settings"].items() if v is not None}
    return content


def _wrong_counts(trace: StoredTrace, record: EvidenceRecord, file: TraceFile) -> Iterator[str]:
    counts = {contacts_topic(pair.name): len(pair.steps) for pair in trace.pairs}
    counts |= {STATE_TOPIC: len(trace.time), EVIDENCE_TOPIC: 1}
    if counts[STATE_TOPIC] != record.steps + 1 or Counter(counts) != Counter(file.messages):
        yield f"its messages by topic are not those of the table, or of {record.steps} steps"
