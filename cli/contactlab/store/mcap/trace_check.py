"""Checks that a trace file is, byte for byte, the encoding of its messages.

Viewers rely on more than readable messages: they seek by the summary, the message indexes and the
statistics, and expect messages in order of time. Each byte is hashed once, and each chunk is
unpacked once, on all cores. C, or without a compiler NumPy, checks its records before the next
chunk replaces it in memory.
"""

import ctypes
import hashlib
import os
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Schema
from numpy.typing import NDArray

from contactlab.errors import CompilerError
from contactlab.native import compile_library, is_wanted
from contactlab.store.mcap.compact_blocks import BLOCKS, read_block
from contactlab.store.mcap.encode_buffers import SCRATCH
from contactlab.store.mcap.file_parts import (
    CHUNK_HEAD,
    DATA_END,
    FramedChunk,
    encode_end,
    file_start,
    frame_chunk,
    with_metadata,
)
from contactlab.store.mcap.message_encoder import STATE_CHANNEL
from contactlab.store.mcap.record_encoder import INDEX_HEAD, ChunkIndexes
from contactlab.store.mcap.stored_messages import (
    ChannelMessages,
    ChunkEntry,
    check_chunk_size,
    read_summary,
    unpack_chunk,
)
from contactlab.store.mcap.trace_messages import (
    EVIDENCE_TOPIC,
    HEAD,
    STATE_TOPIC,
    contacts_record,
    last_state_record,
    pair_of_topic,
    point_counts,
    state_record,
)

_STATES, _CONTACTS = 1, 2  # kinds of records, as chunk_check.c numbers them
_MISMATCH = "the chunks, indexes or summary do not match the messages"
_CUT = "a message is larger than its chunk"
_MISPLACED = "a message index does not match the messages of its chunk"
_UNORDERED = "its messages are not in order of time"
_DIFFERENT = "a message has other fields than its schema"


class CheckedTrace(NamedTuple):
    """The content of a valid file, apart from its contact points."""

    messages: Mapping[str, int]  # number by topic, as in the message form
    trajectory_hash: str
    record_json: bytes
    metadata: Mapping[str, str]
    model_xml: bytes


class _Records(NamedTuple):
    """The content of a chunk, apart from its contact points."""

    states: NDArray[np.float64]  # (rows, 1 + nq + nv)
    times: tuple[int, int]  # first and last log time of its states [ns]
    sizes: Counter[int]  # number of its states by the length of their records
    last_size: int  # length of the last one's
    messages: NDArray[np.int64]  # (channels,) number of messages
    evidence: Sequence[bytes]


@dataclass(frozen=True)
class _Chunk:
    """A compressed chunk, and the (m, 2) entries of its indexes, times and offsets, by channel."""

    packed: memoryview
    size: int
    entries: Mapping[int, NDArray[np.uint64]]


def check_trace(data: bytes) -> CheckedTrace:
    """Return the content of a file without damage; see `find_damage`.

    Raises the errors in `UNREADABLE` if it is not the encoding of its messages.
    """
    summary = read_summary(data)
    [metadata], [model] = summary.metadata, summary.attachments
    schemas, channels = [*summary.schemas.values()], [*summary.channels.values()]
    if [channel.id for channel in channels] != [*range(1, len(channels) + 1)]:
        raise ValueError("its channels are not numbered from 1")
    shared = _shared_part(schemas, channels, model)
    start = with_metadata(shared.start, metadata.name, metadata.metadata)
    position, counts = len(start.data), np.zeros(len(channels), np.int64)
    chunks, framed = list[_Chunk](), list[FramedChunk]()
    is_equal = data.startswith(start.data)
    for entry in summary.chunks:
        chunk, frame = _frame_stored_chunk(data, position, entry)
        is_equal &= data.startswith(frame.parts[0], position)
        position += sum(map(len, frame.parts))
        chunks.append(chunk)
        framed.append(frame._replace(parts=()))
        for channel, entries in chunk.entries.items():
            counts[channel - 1] += len(entries)
    # Its checksum is that of the data, by `find_damage`.
    *_, crc = DATA_END.unpack_from(data, position)
    if not is_equal or data[position:] != encode_end(start, framed, counts.tolist(), crc, position):
        raise ValueError(_MISMATCH)
    check = shared.check
    # The messages of each channel are counted, the states hashed, and the record joined.
    digest, evidence, sizes = hashlib.sha256(), list[bytes](), Counter[int]()
    messages, time, last_size = np.zeros(len(check.channels), np.int64), -1, 0
    for records in _read_chunks(check, chunks):
        first, last = records.times
        if first <= time:
            raise ValueError(_UNORDERED)
        digest.update(np.ascontiguousarray(records.states).data)
        messages += records.messages
        evidence += records.evidence
        sizes += records.sizes
        time, last_size = last, records.last_size
    # All states but the last have a step, all with or all without momentum.
    if last_size != check.last_size or sizes[last_size] != 1 or len(sizes) > 2:
        nq, nv = check.dimensions
        raise ValueError(f"a state message does not hold {nq} positions and {nv} velocities")
    [record_json] = evidence
    topics = (channel.topic for channel in channels)
    counts_by_topic = dict(zip(topics, messages.tolist(), strict=True))
    trajectory_hash = digest.hexdigest()[:32]
    return CheckedTrace(
        counts_by_topic, trajectory_hash, record_json, metadata.metadata, model.data
    )


class _SharedPart:
    """The part that files of one scene share: their start, and the layouts of their records."""

    def __init__(
        self, schemas: Sequence[Schema], channels: Sequence[Channel], model: Attachment
    ) -> None:
        self.definitions = schemas, channels, model
        self.start = file_start(schemas, channels, model)
        self._check: _RecordCheck | None = None

    @property
    def check(self) -> "_RecordCheck":
        """The check of its records. Raises a ValueError if its states have no known layout."""
        most_layouts = 32  # C compares the layout of each message with all that are known
        if self._check is None or self._check.layouts > most_layouts:
            self._check = _RecordCheck(self.definitions[1])
        return self._check


# Encoding the start takes longer than the messages of a short trace.
_RECENT = deque[_SharedPart](maxlen=4)


def _shared_part(
    schemas: Sequence[Schema], channels: Sequence[Channel], model: Attachment
) -> _SharedPart:
    definitions = schemas, channels, model
    for recent in tuple(_RECENT):
        if recent.definitions == definitions:
            return recent
    _RECENT.append(_SharedPart(*definitions))
    return _RECENT[-1]


def _frame_stored_chunk(
    data: bytes, position: int, entry: ChunkEntry
) -> tuple[_Chunk, FramedChunk]:
    # Return a chunk that begins at a position, as stored and as encoded again.
    first = position + CHUNK_HEAD.size
    last = place = first + entry.size
    starts, entries = dict[int, int](), dict[int, NDArray[np.uint64]]()
    for channel, start in sorted(entry.index_starts.items()):
        *_, length = INDEX_HEAD.unpack_from(data, place)
        head = INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, 6 + length, channel, length)
        if start != place or not length or not data.startswith(head, place):
            raise ValueError(_MISMATCH)
        starts[channel] = place - last
        place += INDEX_HEAD.size
        entries[channel] = np.frombuffer(data, "<u8", length // 8, place).reshape(-1, 2)
        place += length
    if STATE_CHANNEL not in entries:
        raise ValueError("a chunk has no state")
    times = entries[STATE_CHANNEL][[0, -1], 0].tolist()
    view = memoryview(data)
    packed, index = view[first:last], ChunkIndexes(data[last:place], starts)
    frame = frame_chunk(packed, entry.unpacked_size, times, index, position)
    return _Chunk(packed, entry.unpacked_size, entries), frame


def _read_chunks(check: "_RecordCheck", chunks: Sequence[_Chunk]) -> Iterator[_Records]:
    # A few chunks are read ahead, so that memory stays bounded. The thread that hashes keeps
    # pace with about four others.
    cores = min(os.cpu_count() or 1, 4)
    if cores == 1 or len(chunks) < 4:  # threads take longer to start
        yield from map(check.read_chunk, chunks)
        return
    with ThreadPoolExecutor(cores) as pool:
        ahead = deque[Future[_Records]]()
        for chunk in chunks:
            ahead.append(pool.submit(check.read_chunk, chunk))
            if len(ahead) > 2 * cores:
                yield ahead.popleft().result()
        yield from (each.result() for each in ahead)


class _RecordCheck:
    """Reads the records of chunks that fit the layouts of their channels."""

    def __init__(self, channels: Sequence[Channel]) -> None:
        self.channels = channels
        [state] = [each for each in channels if each.topic == STATE_TOPIC]
        if state.id != STATE_CHANNEL:
            raise ValueError("its states are not in the first channel")
        self.dimensions = nq, nv = int(state.metadata["nq"]), int(state.metadata["nv"])
        last = last_state_record(nq, nv)
        self.last_size = last.size
        self._blocks = {each.id for each in channels if each.message_encoding == BLOCKS}
        kinds = {STATE_TOPIC: _STATES} | {
            each.topic: _CONTACTS for each in channels if pair_of_topic(each.topic)
        }
        self._kinds = np.array(
            [0 if each.id in self._blocks else kinds.get(each.topic, 0) for each in channels]
        )
        states = (state_record(nq, nv, 0), state_record(nq, nv, 3), last)
        self._layouts = {(_STATES, each.size): each for each in states}
        # Time, positions and velocities have the same places in all of them.
        fields = [last.fields[name] for name in ("time", "qpos", "qvel")]
        self._spans = np.array([(each.start, 8 * each.starts.size) for each in fields])

    @property
    def layouts(self) -> int:
        """The number of layouts of records that are known so far."""
        return len(self._layouts)

    def read_chunk(self, chunk: _Chunk) -> _Records:
        """Return the content of a chunk. Raises a ValueError if it does not fit."""
        check_chunk_size(chunk.packed, chunk.size)
        content = SCRATCH.take_buffer("chunk", chunk.size)
        unpack_chunk(chunk.packed, content)
        check = _load_checker() if is_wanted() else None
        read_messages = self._read_by_columns if check is None else partial(self._read_in_c, check)
        states, sizes = read_messages(content, chunk)
        messages = np.zeros(len(self.channels), np.int64)
        for channel, entries in chunk.entries.items():
            messages[channel - 1] = len(entries)
        evidence = [
            block
            for channel in self.channels
            if channel.topic == EVIDENCE_TOPIC and channel.id in chunk.entries
            for block in _iterate_contents(content, chunk.entries[channel.id])
        ]
        if self._blocks:
            return self._expand_blocks(content, chunk, messages, evidence)
        ordered = chunk.entries[STATE_CHANNEL]
        [last_size] = ChannelMessages(content, ordered[-1:, 1].astype(np.int64)).sizes.tolist()
        times = int(ordered[0, 0]), int(ordered[-1, 0])
        return _Records(states, times, sizes, last_size, messages, evidence)

    def _read_in_c(
        self, check: Callable[..., int], content: NDArray[np.uint8], chunk: _Chunk
    ) -> tuple[NDArray[np.float64], Counter[int]]:
        # Return the states, and their number by the length of their records.
        count = len(chunk.entries[STATE_CHANNEL])
        states = np.empty((count, int(self._spans[:, 1].sum()) // 8))
        while True:
            channels = np.zeros((len(self.channels), 4), np.int64)
            channels[:, 3] = self._kinds
            for channel, entries in chunk.entries.items():
                channels[channel - 1, :2] = entries.ctypes.data, len(entries)
            known_layouts = [*self._layouts.items()]
            layouts = np.array(
                [
                    (*key, each.template_bytes.ctypes.data, each.mask.ctypes.data, 0)
                    for key, each in known_layouts
                ]
            )
            tables = [
                value
                for table in (channels, layouts, self._spans)
                for value in (table.ctypes.data, len(table))
            ]
            result = check(content.ctypes.data, len(content), *tables, states.ctypes.data)
            if result >= 0:
                break
            self._add_layout(content, -result - 1)
        if result:
            raise ValueError((_CUT, _MISPLACED, _UNORDERED, _DIFFERENT)[result - 1])
        layout_counts = zip(known_layouts, layouts[:, 4].tolist(), strict=True)
        return states, Counter(
            {size: n for ((kind, size), _), n in layout_counts if n and kind == _STATES}
        )

    def _add_layout(self, content: NDArray[np.uint8], offset: int) -> None:
        head = ChannelMessages(content, np.array([offset]))
        kind, size = int(self._kinds[head.heads["channel"][0] - 1]), head.sizes
        if kind == _STATES:
            nq, nv = self.dimensions
            raise ValueError(f"a state message does not hold {nq} positions and {nv} velocities")
        self._layouts[kind, int(size[0])] = contacts_record(int(point_counts(size)[0]))

    def _read_by_columns(
        self, content: NDArray[np.uint8], chunk: _Chunk
    ) -> tuple[NDArray[np.float64], Counter[int]]:
        # Return the same as `_read_in_c`, without a compiler.
        ids = np.repeat([*chunk.entries], [len(each) for each in chunk.entries.values()])
        entries = np.concatenate([*chunk.entries.values()])
        order = np.argsort(entries[:, 1], kind="stable")
        ids, times, offsets = ids[order], entries[order, 0], entries[order, 1].astype(np.int64)
        if offsets[0] or offsets[-1] + HEAD.itemsize > len(content):
            raise ValueError(_MISPLACED)
        messages = ChannelMessages(content, offsets)
        heads, sizes = messages.heads, messages.sizes
        read_heads = np.column_stack((heads["opcode"], heads["channel"], heads["log_time"]))
        expected_heads = np.column_stack((np.full_like(ids, Opcode.MESSAGE), ids, times))
        if np.any(read_heads != expected_heads) or np.any(
            np.diff(offsets, append=len(content)) != sizes
        ):
            raise ValueError(_MISPLACED)
        if heads["sequence"].any() or np.any(heads["publish_time"] != times):
            raise ValueError(_DIFFERENT)
        later = np.where(
            ids[1:] == STATE_CHANNEL,
            times[1:] > times[:-1],
            (ids[1:] > ids[:-1]) & (times[1:] == times[:-1]),
        )
        if ids[0] != STATE_CHANNEL or not later.all():
            raise ValueError(_UNORDERED)
        kinds, state_sizes = self._kinds[ids - 1], Counter[int]()
        states = np.empty((len(chunk.entries[STATE_CHANNEL]), int(self._spans[:, 1].sum()) // 8))
        for kind, size in np.unique(np.column_stack((kinds, sizes))[kinds > 0], axis=0).tolist():
            chosen = (kinds == kind) & (sizes == size)
            if (kind, size) not in self._layouts:
                self._add_layout(content, int(offsets[chosen][0]))
            items = messages.pick_records(chosen, self._layouts[kind, size])
            if kind == _STATES:
                state_sizes[size] = len(items)
                rows = sizes[ids == STATE_CHANNEL] == size
                states[rows] = np.column_stack((items["time"], items["qpos"], items["qvel"]))
        return states, state_sizes

    def _expand_blocks(
        self,
        content: NDArray[np.uint8],
        chunk: _Chunk,
        messages: NDArray[np.int64],
        evidence: Sequence[bytes],
    ) -> _Records:
        groups = {
            channel: [
                group
                for block in _iterate_contents(content, chunk.entries[channel])
                for group in read_block(self.channels[channel - 1], block)
            ]
            for channel in sorted(self._blocks & chunk.entries.keys())
        }
        times = {
            channel: np.concatenate([items["log_time"] for _, items in blocks])
            for channel, blocks in groups.items()
        }
        state_times = times[STATE_CHANNEL]
        if np.any(state_times[1:] <= state_times[:-1]):
            raise ValueError(_UNORDERED)
        for channel, blocks in groups.items():
            topic, own = self.channels[channel - 1].topic, times[channel]
            rows = np.searchsorted(state_times, own)
            is_known = np.array_equal(state_times[np.minimum(rows, len(state_times) - 1)], own)
            if not is_known or any(np.any(np.diff(items["log_time"]) <= 0) for _, items in blocks):
                raise ValueError(f"messages of {topic} are out of order, or have no state")
            # Sorting is many times faster than looking for distinct values.
            if not np.diff(np.sort(own)).all():
                raise ValueError("a channel has two messages of one time")
            messages[channel - 1] = len(own)
        blocks, sizes = groups[STATE_CHANNEL], Counter[int]()
        for layout, items in blocks:
            sizes[layout.size] += len(items)
        states = np.concatenate(
            [np.column_stack((i["time"], i["qpos"], i["qvel"])) for _, i in blocks]
        )
        bounds = int(state_times[0]), int(state_times[-1])
        return _Records(states, bounds, sizes, blocks[-1][0].size, messages, evidence)


def _iterate_contents(content: NDArray[np.uint8], entries: NDArray[np.uint64]) -> Iterator[bytes]:
    return ChannelMessages(content, entries[:, 1].astype(np.int64)).iterate_contents()


@cache
def _load_checker() -> Callable[..., int] | None:
    # Without a compiler, NumPy checks the records.
    try:
        check = ctypes.CDLL(
            str(compile_library(Path(__file__).with_name("chunk_check.c")))
        ).check_chunk
    except (CompilerError, OSError):
        return None
    pointer, number = ctypes.c_void_p, ctypes.c_int64
    check.argtypes = (*[pointer, number] * 4, pointer)
    check.restype = number
    return check
