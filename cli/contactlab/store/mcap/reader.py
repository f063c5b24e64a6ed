"""Read a trace file of our own, all messages of a channel at once."""

import struct
from io import BytesIO
from pathlib import Path

import numpy as np
import zstandard
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.summary import Summary

from contactlab.errors import StoreError
from contactlab.store.mcap.chunks import CHUNK_HEAD, INDEX_HEAD
from contactlab.store.mcap.decode import Messages, Offsets, state_arrays, stored_pair
from contactlab.store.mcap.descriptor import file_descriptor_set
from contactlab.store.mcap.integrity import damage
from contactlab.store.mcap.messages import CONTACTS, STATE
from contactlab.store.mcap.stored import StoredTrace
from contactlab.store.mcap.topics import EVIDENCE_TOPIC, STATE_TOPIC, pair_of

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
    if problem := damage(data):
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
    pairs = {name: topic for topic in channels if (name := pair_of(topic)) is not None}
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


def channel_messages(data: bytes, summary: Summary) -> dict[int, Messages]:
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
        channel: Messages(stream, np.concatenate((none, *parts)))
        for channel, parts in offsets.items()
    }
