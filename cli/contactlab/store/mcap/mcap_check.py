"""Check a trace file: its structure, and its record.

Viewers rely on more than readable messages: they seek by the summary, the message indexes and the
statistics, and expect messages in order of time. So a file must be, byte for byte, what is written
of its messages.
"""

import json
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mcap.opcode import Opcode

from contactlab.contact.trace_arrays import hash_of_states
from contactlab.errors import StoreError
from contactlab.schema.evidence import EvidenceRecord, TraceFile
from contactlab.store.atomic_files import sha256_of
from contactlab.store.mcap.file_parts import (
    FileStart,
    MessageStream,
    encode_file,
    file_start,
    with_metadata,
)
from contactlab.store.mcap.message_encoder import STATE_CHANNEL
from contactlab.store.mcap.stored_messages import (
    UNREADABLE,
    StoredFile,
    find_damage,
    stored_file,
)
from contactlab.store.mcap.trace_messages import EVIDENCE_TOPIC, STATE_TOPIC, contacts_topic
from contactlab.store.mcap.trace_reader import ACTIVATIONS, StoredTrace, read_trace

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
        again = written_again(stored_file(data))
    except UNREADABLE as error:
        return [f"a record cannot be decoded: {error}"]
    return [] if again == data else ["its chunks, indexes or summary are not those of its messages"]


def written_again(file: StoredFile) -> bytes:
    """Return the file that stored messages give, whose chunks are compressed as they were."""
    stream = message_stream(file)
    begins = [chunk.message_start_time for chunk in file.summary.chunk_indexes]
    rows = np.searchsorted(stream.times, np.array(begins, np.uint64)).tolist()
    return encode_file(start_of(file), stream, dict(zip(rows, file.chunks, strict=True)))[0]


def start_of(file: StoredFile) -> FileStart:
    """Return how a file begins that has these schemas, channels, model and metadata."""
    schemas, channels = file.summary.schemas.values(), file.summary.channels.values()
    start = file_start([*schemas], [*channels], file.model)
    return with_metadata(start, file.metadata.name, file.metadata.metadata)


def message_stream(file: StoredFile) -> MessageStream:
    """Return stored messages as they are to lie in the chunks, one after the other."""
    state = file.messages[STATE_CHANNEL]
    times = state.heads["log_time"]
    if np.any(times[1:] <= times[:-1]):
        raise ValueError("its states are not in order of time")
    sizes = np.zeros((len(times), len(file.messages)), np.int64)
    for channel, each in file.messages.items():
        heads = each.heads
        if np.any((heads["opcode"] != Opcode.MESSAGE) | (heads["channel"] != channel)):
            raise ValueError("a message index points at something else")
        sizes[np.searchsorted(times, heads["log_time"]), channel - 1] = each.sizes
    ends = np.cumsum(sizes)
    return MessageStream(state.data[: ends[-1]], ends.reshape(sizes.shape) - sizes, sizes, times)


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
