"""Interleave messages in order of time, split them into chunks and index them, by NumPy.

Source of the record layouts: https://mcap.dev/spec
"""

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from mcap.opcode import Opcode
from mcap.records import ChunkIndex
from numpy.typing import NDArray

from contactlab.store.mcap.message_encoder import SCRATCH, MessageGroup

Times = NDArray[np.uint64]

CHUNK_SIZE = 1 << 20
_COMPRESSION = "zstd"

CHUNK_HEAD = struct.Struct(f"<BQQQQII{len(_COMPRESSION)}sQ")
INDEX_HEAD = struct.Struct("<BQHI")
# The content's checksum is zstd's own, which takes a tenth of the time and which decoders verify.
_NO_CRC = 0
_FRAME_SIZE = 9
_ENTRY_SIZE = 16


@dataclass(frozen=True)
class MessageStream:
    """The messages of a whole run, interleaved.

    Attributes:
        data: (bytes,) Message records, ordered by state row, then by channel.
        offsets: (rows, channels) where each record starts.
        sizes: (rows, channels) its length; 0 where a channel has no message.
        times: (rows,) log time [ns].
    """

    data: NDArray[np.uint8]
    offsets: NDArray[np.int64]
    sizes: NDArray[np.int64]
    times: Times

    def cuts(self) -> list[int]:
        """Return the rows at which chunks start, and the number of rows.

        Records of one row stay together; a row that crosses a multiple of CHUNK_SIZE ends its
        chunk.
        """
        block = self.offsets[:, 0] // CHUNK_SIZE
        return [0, *(np.flatnonzero(np.diff(block)) + 1).tolist(), len(block)]


def interleave(groups: Sequence[MessageGroup], channels: int, times: Times) -> MessageStream:
    """Return the records of all groups in one buffer, valid until the next call."""
    sizes = np.zeros((len(times), channels), np.int64)
    for group in groups:
        sizes[group.span, group.channel - 1] = group.layout.size
    ends = np.cumsum(sizes)
    offsets = ends.reshape(sizes.shape) - sizes
    data = SCRATCH.take("stream", int(ends[-1]))
    for group in groups:
        records = overlapping(data, group.layout.size)
        records[offsets[group.span, group.channel - 1]] = _records(group, times)
    return MessageStream(data, offsets, sizes, times)


def _records(group: MessageGroup, times: Times) -> NDArray[np.void]:
    size = group.layout.size
    memory = SCRATCH.take("records", len(group.rows) * size)
    items = group.layout.fill(memory)
    items["channel"] = group.channel
    items["log_time"] = items["publish_time"] = times[group.span]
    group.fill(items)
    return items.view(f"V{size}")


def overlapping(data: NDArray[np.uint8], size: int) -> NDArray[np.void]:
    """Return a view whose item i is the `size` bytes that start at byte i."""
    return np.ndarray((max(len(data) - size + 1, 0),), f"V{size}", data, strides=(1,))


def chunk_records(stream: MessageStream, position: int) -> Iterator[tuple[list[bytes], ChunkIndex]]:
    """Yield each chunk and its message indexes as bytes, and its index for the summary.

    Args:
        stream: the messages.
        position: offset of the first chunk in the file.
    """
    for start, stop in pairwise(stream.cuts()):
        rows = slice(start, stop)
        chunk, compressed_size, size = _chunk(stream, rows)
        indexes = dict(_message_indexes(stream, rows))
        chunk_length = sum(map(len, chunk))
        end, offsets = position + chunk_length, dict[int, int]()
        for channel, index in indexes.items():
            offsets[channel] = end
            end += len(index)
        yield (
            [*chunk, *indexes.values()],
            ChunkIndex(
                chunk_length=chunk_length,
                chunk_start_offset=position,
                compression=_COMPRESSION,
                compressed_size=compressed_size,
                message_end_time=int(stream.times[stop - 1]),
                message_index_length=end - position - chunk_length,
                message_index_offsets=offsets,
                message_start_time=int(stream.times[start]),
                uncompressed_size=size,
            ),
        )
        position = end


def _chunk(stream: MessageStream, rows: slice) -> tuple[list[bytes], int, int]:
    """Return a Chunk record in two parts, its compressed size and its own."""
    ends = stream.offsets[rows.stop, 0] if rows.stop < len(stream.times) else len(stream.data)
    content = stream.data[stream.offsets[rows.start, 0] : ends].data
    compressed = SCRATCH.compressor.compress(content)
    head = CHUNK_HEAD.pack(
        Opcode.CHUNK,
        CHUNK_HEAD.size - _FRAME_SIZE + len(compressed),
        int(stream.times[rows.start]),
        int(stream.times[rows.stop - 1]),
        len(content),
        _NO_CRC,
        len(_COMPRESSION),
        _COMPRESSION.encode(),
        len(compressed),
    )
    return [head, compressed], len(compressed), len(content)


def _message_indexes(stream: MessageStream, rows: slice) -> Iterator[tuple[int, bytes]]:
    """Yield each channel with messages in these rows, and its MessageIndex record."""
    times, sizes = stream.times[rows], stream.sizes[rows]
    offsets = stream.offsets[rows] - stream.offsets[rows.start, 0]
    for column in range(sizes.shape[1]):
        used = np.flatnonzero(sizes[:, column])
        if len(used):
            entries = np.empty((len(used), 2), "<u8")
            entries[:, 0] = times[used]
            entries[:, 1] = offsets[used, column]
            length = len(used) * _ENTRY_SIZE
            channel = column + 1
            head = INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, 6 + length, channel, length)
            yield channel, head + entries.tobytes()
