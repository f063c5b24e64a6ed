"""Writes Message records, indexes of chunks and values of blocks by NumPy.

The records of a group are filled column by column, then scattered over the chunks.
"""

import struct
from collections.abc import Callable, Mapping
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from contactlab.store.mcap.encode_buffers import SCRATCH
from contactlab.store.mcap.trace_messages import MessageLayout

Bytes = NDArray[np.uint8]
Rows = NDArray[np.intp]
Integers = NDArray[np.int64]
Items = NDArray[np.void]
Unsigned = NDArray[np.unsignedinteger]

INDEX_HEAD = struct.Struct("<BQHI")
_BLOCK_BYTES = 1 << 19  # bytes of records that are filled at once


class Records(NamedTuple):
    """Message records of one length, of one run: channel by channel, in ascending rows."""

    channels: Rows  # (m,) the id of each record's channel
    rows: Rows  # (m,) its state row
    layout: MessageLayout
    gather: Callable[[Rows, Rows], Mapping[str, NDArray[Any]]]
    """Returns the numbers for records of some (k,) channels and rows: (k, ...) by the path of
    their field in a record."""

    def select_records(self, some: slice) -> "Records":
        """Return some of them."""
        return self._replace(channels=self.channels[some], rows=self.rows[some])


def write_records(records: Records, data: Bytes, starts: Integers) -> None:
    """Write records at their starts (m,) in a buffer, in blocks that fit into a cache."""
    layout = records.layout
    stride = max(1, _BLOCK_BYTES // layout.size)
    for first in range(0, len(starts), stride):
        some = slice(first, first + stride)
        channels, rows = records.channels[some], records.rows[some]
        items = layout.fill_items(SCRATCH.take_buffer("records", len(rows) * layout.size))
        values = records.gather(channels, rows)
        with np.errstate(over="ignore"):
            for path in layout.fields:
                target = items
                for name in path.split("."):
                    target = target[name]
                target[...] = values[path]
        overlapping_view(data, layout.size)[starts[some]] = items.view(f"V{layout.size}")


def message_indexes(
    times: NDArray[np.uint64], sizes: Integers, offsets: Integers
) -> tuple[bytes, dict[int, int]]:
    """Return the MessageIndex records of a chunk, and the start of each channel's among them.

    It has messages of these (rows, channels) sizes at offsets from the start of all chunks.
    """
    used = np.ascontiguousarray(sizes.T) != 0
    entries = np.empty((np.count_nonzero(used), 2), np.uint64)
    entries[:, 0] = np.broadcast_to(times, used.shape)[used]
    entries[:, 1] = (offsets - offsets[0, 0]).T[used]
    counts, data = np.count_nonzero(used, axis=1), entries.tobytes()
    channels = np.flatnonzero(counts)
    entry_size = 16  # of a time and an offset, each of 8 bytes
    ends = accumulate((counts[channels] * entry_size).tolist(), initial=0)
    parts = [data[start:end] for start, end in pairwise(ends)]
    found = [*map(_encode_index, numbers := (channels + 1).tolist(), parts)]
    starts = accumulate(map(len, found), initial=0)
    return b"".join(found), dict(zip(numbers, starts, strict=False))


def pack_values(records: Bytes, layout: MessageLayout, data: Bytes) -> None:
    """Write the values of records to a buffer in the form of a block, width by width."""
    items = records.view(layout.dtype)
    for width, places in layout.values:
        values = overlapping_numbers(items, width)[:, places]
        for _ in range(2):
            values[1:] -= values[:-1].copy()
        signed = values.view(f"<i{width}")
        signs = signed >> (8 * width - 1)
        signed <<= 1
        signed ^= signs
        columns = np.ascontiguousarray(signed.T).view(np.uint8).reshape(-1, width)
        data[: columns.size] = columns.T.ravel()
        data = data[columns.size :]


def span_of(rows: Rows) -> Rows | slice:
    """Return rows as a slice if they are consecutive, which indexes without a copy."""
    consecutive = len(rows) > 0 and rows[-1] - rows[0] == len(rows) - 1
    return slice(int(rows[0]), int(rows[-1]) + 1) if consecutive else rows


def overlapping_view(data: Bytes, size: int) -> NDArray[np.void]:
    """Return a view with the `size` bytes that start at byte i as item i."""
    return np.ndarray((max(len(data) - size + 1, 0),), f"V{size}", data, strides=(1,))


def overlapping_numbers(items: Items, width: int) -> Unsigned:
    """Return a view with the number that starts at byte j of record i as item (i, j)."""
    size = items.dtype.itemsize
    shape = len(items), size - width + 1
    return np.ndarray(shape, f"<u{width}", items.view(np.uint8), strides=(size, 1))


def _encode_index(channel: int, entries: bytes) -> bytes:
    length = len(entries)
    return INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, 6 + length, channel, length) + entries
