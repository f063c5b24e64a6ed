"""Message records back into arrays."""

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.summary import Summary
from numpy.typing import NDArray

from contactlab.contact import FOUND, SLOT_WIDTH, Floats
from contactlab.errors import StoreError
from contactlab.store.mcap.chunk_writer import CHUNK_HEAD, INDEX_HEAD, overlapping
from contactlab.store.mcap.mcap_survey import find_damage
from contactlab.store.mcap.message_encoder import POINT_FIELDS
from contactlab.store.mcap.message_layout import (
    HEADER_SIZE,
    MessageLayout,
    contacts_record,
    last_state_record,
    state_record,
)
from contactlab.store.mcap.stored_trace import StoredPair, StoredTrace
from contactlab.store.mcap.trace_schema import (
    CONTACTS,
    EVIDENCE_TOPIC,
    STATE,
    STATE_TOPIC,
    file_descriptor_set,
    pair_of_topic,
)

Offsets = NDArray[np.int64]


@dataclass(frozen=True)
class ChannelMessages:
    """Message records of one channel, scattered over a buffer.

    Attributes:
        data: (bytes,) the content of all chunks.
        offsets: (M,) where each record starts, in time order.
    """

    data: NDArray[np.uint8]
    offsets: Offsets

    @property
    def sizes(self) -> NDArray[np.int64]:
        """(M,) length of each record, its nine bytes of opcode and length included."""
        lengths = overlapping(self.data, 8)[self.offsets + 1].view("<u8")
        return lengths.astype(np.int64) + 9

    def pick(self, chosen: slice | NDArray[np.bool_], layout: MessageLayout) -> NDArray[np.void]:
        """Return the chosen records, which must all have this layout."""
        items = overlapping(self.data, layout.size)[self.offsets[chosen]]
        return items.view(layout.dtype)

    def blob(self) -> bytes:
        """Return the content of the one message."""
        [start], [size] = self.offsets.tolist(), self.sizes.tolist()
        return self.data[start + HEADER_SIZE : start + size].tobytes()


def state_arrays(
    messages: ChannelMessages, nq: int, nv: int
) -> tuple[Mapping[str, Any], NDArray[Any]]:
    """Return the arrays of all states and steps by their names in a trace, and the log times."""
    sizes = messages.sizes
    fitting = [m for m in (0, 3) if np.all(sizes[:-1] == state_record(nq, nv, m).size)]
    if not fitting or sizes[-1] != last_state_record(nq, nv).size:
        raise ValueError(f"a state message does not hold {nq} positions and {nv} velocities")
    stepped = messages.pick(slice(None, -1), state_record(nq, nv, fitting[0]))
    last = messages.pick(slice(-1, None), last_state_record(nq, nv))
    names = ("time", "qpos", "qvel")
    states = {name: np.concatenate((stepped[name], last[name])) for name in names}
    times = np.concatenate((stepped["log_time"], last["log_time"]))
    return states | _step_arrays(stepped["step"], momentum=fitting[0] > 0), times


def _step_arrays(step: NDArray[np.void], *, momentum: bool) -> dict[str, Any]:
    return {
        "kinetic": step["kinetic_energy"].copy(),
        "potential": step["potential_energy"].copy(),
        "contacts": step["contacts"].astype(np.int32),
        "least_distance": step["least_distance"].copy(),
        "iterations": step["solver_iterations"].astype(np.int32),
        "iterations_most": step["solver_iterations_most"].astype(np.int32),
        "momentum": step["linear_momentum"].copy() if momentum else None,
        "angular_momentum": step["angular_momentum"].copy() if momentum else None,
    }


def stored_pair(name: str, messages: ChannelMessages, times: NDArray[Any]) -> StoredPair:
    """Return a pair's contacts.

    Args:
        name: the pair's name.
        messages: its messages.
        times: (N + 1,) log time of the states.
    """
    counts = _counts(messages.sizes)
    net = np.empty(len(counts), _NET)
    points = np.zeros((counts.sum(), SLOT_WIDTH))
    starts = np.cumsum(counts) - counts
    for count in np.unique(counts).tolist():
        chosen = counts == count
        items = messages.pick(chosen, contacts_record(count))
        for field in _NET.names or ():
            net[field][chosen] = items[field]
        rows = starts[chosen][:, None] + np.arange(count)
        points[rows] = _slots(items)
    steps = np.searchsorted(times, net["log_time"])
    if not np.array_equal(times[steps], net["log_time"]):
        raise ValueError(f"a contact of '{name}' has no state of its time")
    return StoredPair(
        name=name,
        steps=steps.astype(np.int32),
        contacts=counts.astype(np.int32),
        found=net["found"].astype(np.int32),
        mode=net["mode"].astype(np.int8),
        normal=net["normal_force"].copy(),
        tangential=net["tangential_force"].copy(),
        usage=net["friction_usage"].copy(),
        slip=net["slip_speed"].copy(),
        distance=net["distance"].copy(),
        points=points,
    )


def _counts(sizes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the contact points of messages by their length."""
    none = contacts_record(0).size
    counts, rest = np.divmod(sizes - none, contacts_record(1).size - none)
    if np.any(rest) or np.any(counts < 1):
        raise ValueError("a contact message has another layout")
    return counts


def _slots(items: NDArray[np.void]) -> Floats:
    """(m, count, 23) contact slots of messages with `count` points each."""
    points = items["points"]
    slots = np.empty((*points.shape, SLOT_WIDTH))
    slots[..., FOUND] = items["found"][:, None]
    for name, columns in POINT_FIELDS.items():
        slots[..., columns] = points[name]
    return slots


_NET = np.dtype(
    [
        ("log_time", "u8"),
        ("found", "u4"),
        ("mode", "u1"),
        ("normal_force", "f8"),
        ("tangential_force", "f8"),
        ("friction_usage", "f8"),
        ("slip_speed", "f8"),
        ("distance", "f8"),
    ]
)


# What the bytes of a whole but foreign file can raise.
_FOREIGN = (McapError, struct.error, zstandard.ZstdError, ValueError, LookupError)


def read_trace(path: Path, named: object = None) -> StoredTrace:
    """Return the run that a trace file holds.

    Args:
        path: the file.
        named: what messages call it, if it is not that file.

    Raises:
        StoreError: the file is missing, damaged, or not a trace of this version.
    """
    named = named or path
    try:
        data = path.read_bytes()
    except OSError as error:
        raise StoreError(f"cannot read {named}: {error.strerror}") from error
    if problem := find_damage(data):
        raise StoreError(f"{named}: {problem}; the run has to be repeated")
    try:
        return _decode(data)
    except _FOREIGN as error:
        raise StoreError(
            f"{named} is no trace that this version of contactlab can read: {error}"
        ) from error


def _decode(data: bytes) -> StoredTrace:
    reader = SeekingReader(BytesIO(data))
    summary = reader.get_summary()
    assert summary is not None, "damage() finds a missing summary"
    _check_schemas(summary)
    messages = channel_messages(data, summary)
    channels = {channel.topic: channel for channel in summary.channels.values()}
    sizes = channels[STATE_TOPIC].metadata
    state = messages[channels[STATE_TOPIC].id]
    arrays, times = state_arrays(state, int(sizes["nq"]), int(sizes["nv"]))
    pairs = {name: topic for topic in channels if (name := pair_of_topic(topic)) is not None}
    [metadata], [model] = reader.iter_metadata(), reader.iter_attachments()
    return StoredTrace(
        **arrays,
        pairs=tuple(
            stored_pair(name, messages[channels[topic].id], times) for name, topic in pairs.items()
        ),
        record_json=messages[channels[EVIDENCE_TOPIC].id].blob(),
        metadata=metadata.metadata,
        model_xml=model.data,
    )


def _check_schemas(summary: Summary) -> None:
    stored = {schema.data for schema in summary.schemas.values()}
    for message in (STATE, CONTACTS):
        if file_descriptor_set(message) not in stored:
            raise ValueError(f"its schema of {message.name} is another one")


def channel_messages(data: bytes, summary: Summary) -> dict[int, ChannelMessages]:
    """Return the messages by channel id, in the order of the chunks, which is that of time."""
    offsets: dict[int, list[Offsets]] = {channel: [] for channel in summary.channels}
    contents: list[bytes] = []
    base = 0
    for chunk in summary.chunk_indexes:
        start = chunk.chunk_start_offset + CHUNK_HEAD.size
        compressed = memoryview(data)[start : start + chunk.compressed_size]
        contents.append(zstandard.decompress(compressed, chunk.uncompressed_size))
        for channel, place in chunk.message_index_offsets.items():
            *_, length = INDEX_HEAD.unpack_from(data, place)
            entries = np.frombuffer(data, "<u8", length // 8, place + INDEX_HEAD.size)
            offsets[channel].append(entries[1::2].astype(np.int64) + base)
        base += chunk.uncompressed_size
    stream = np.frombuffer(b"".join(contents), np.uint8)
    none = np.empty(0, np.int64)
    return {
        channel: ChannelMessages(stream, np.concatenate((none, *parts)))
        for channel, parts in offsets.items()
    }
