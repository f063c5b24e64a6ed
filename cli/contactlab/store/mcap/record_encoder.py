"""Writes Message records, indexes of chunks and values of blocks.

Records are filled in C, record by record, or without a compiler by NumPy, column by column.
"""

import ctypes
import struct
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from contactlab.errors import CompilerError
from contactlab.native import compile_library, is_wanted
from contactlab.store.mcap.encode_buffers import SCRATCH
from contactlab.store.mcap.trace_messages import FieldPlace, MessageLayout

Bytes = NDArray[np.uint8]
Rows = NDArray[np.intp]
Integers = NDArray[np.int64]
Items = NDArray[np.void]
Unsigned = NDArray[np.unsignedinteger]

INDEX_HEAD = struct.Struct("<BQHI")
_BLOCK_BYTES = 1 << 19  # bytes of records that NumPy fills at once


class Columns:
    """Numbers of the messages of n runs, channel by channel.

    Each array is (n, rows, ...), by the path of its field in a record. Addresses are looked up once
    for all runs, because that takes longer than filling a short run's records.
    """

    def __init__(self, arrays: Mapping[int, Mapping[str, NDArray[Any]]]) -> None:
        """Take the arrays of channels by their ids, in order; all channels have the same fields."""
        self.ids = np.array([*arrays])
        self._channels = [*arrays.values()]
        self._sources: dict[tuple[str, ...], tuple[Integers, list[NDArray[Any]]]] = {}

    def find_arrays(self, channel: int) -> Mapping[str, NDArray[Any]]:
        """Return arrays of a channel."""
        return self._channels[int(np.searchsorted(self.ids, channel))]

    def locate_sources(self, layout: MessageLayout, run: int) -> Integers:
        """Return (channels, fields, 3) addresses of a run's first numbers, and their strides."""
        paths = tuple(layout.fields)
        if paths not in self._sources:
            # Numbers as a record holds them, with those of an item next to each other.
            arrays = [
                _packed_numbers(arrays[path], place)
                for arrays in self._channels
                for path, place in layout.fields.items()
            ]
            table = [(each.ctypes.data, *each.strides[:3], 0)[:4] for each in arrays]
            shape = len(self._channels), len(paths), 4
            self._sources[paths] = np.array(table, np.int64).reshape(shape), arrays
        table, _ = self._sources[paths]
        address, stride = table[..., 0], table[..., 1]
        return np.stack([address + run * stride, table[..., 2], table[..., 3]], axis=-1)


def _packed_numbers(array: NDArray[Any], place: FieldPlace) -> NDArray[Any]:
    # The types that `fill_records` takes.
    kind = np.dtype("<f8") if place.kind == np.float32 else place.kind
    packed = array.astype(kind, copy=False)
    is_vector = bool(place.shape) and place.strides[-1] == place.kind.itemsize
    is_scattered = is_vector and packed.strides[-1] != packed.itemsize
    return np.ascontiguousarray(packed) if is_scattered else packed


class Records(NamedTuple):
    """Message records of one length, of one run: channel by channel, in ascending rows."""

    channels: Rows  # (m,) the id of each record's channel
    rows: Rows  # (m,) its state row
    layout: MessageLayout
    columns: Columns
    run: int

    def select_records(self, some: slice) -> "Records":
        """Return some of them."""
        return self._replace(channels=self.channels[some], rows=self.rows[some])


@cache
def _load_library() -> ctypes.CDLL | None:
    # Without a compiler, NumPy writes the records.
    try:
        library = ctypes.CDLL(str(compile_library(Path(__file__).with_suffix(".c"))))
    except (CompilerError, OSError):
        return None
    pointer, number = ctypes.c_void_p, ctypes.c_int64
    library.fill_records.argtypes = (
        pointer,
        number,
        *[pointer] * 3,
        ctypes.c_char_p,
        number,
        pointer,
        pointer,
        number,
    )
    library.fill_records.restype = None
    library.unpack_values.argtypes = (pointer, *[number] * 3, *[pointer] * 3, number)
    library.unpack_values.restype = None
    return library


def write_records(records: Records, data: Bytes, starts: Integers) -> None:
    """Write records at their starts (m,) in a buffer."""
    layout, columns = records.layout, records.columns
    library = _load_library() if is_wanted() else None
    if library is None or not len(starts):
        _write_by_columns(records, data, starts)
        return
    places, sources = layout.places, columns.locate_sources(layout, records.run)
    channels = np.searchsorted(columns.ids, records.channels)
    arrays = [np.ascontiguousarray(each, np.int64) for each in (starts, channels, records.rows)]
    addresses = [each.ctypes.data for each in arrays]
    library.fill_records(
        data.ctypes.data,
        len(starts),
        *addresses,
        layout.template,
        layout.size,
        places.ctypes.data,
        sources.ctypes.data,
        len(places),
    )


def _write_by_columns(records: Records, data: Bytes, starts: Integers) -> None:
    layout = records.layout
    # Blocks of records fit into a cache.
    stride = max(1, _BLOCK_BYTES // layout.size)
    changes = np.flatnonzero(np.diff(records.channels)) + 1
    for begin, end in pairwise([0, *changes.tolist(), len(starts)]):
        for first in range(begin, end, stride):
            some = slice(first, min(first + stride, end))
            rows = records.rows[some]
            items = layout.fill_items(SCRATCH.take_buffer("records", len(rows) * layout.size))
            arrays = records.columns.find_arrays(int(records.channels[begin]))
            with np.errstate(over="ignore"):
                for path in layout.fields:
                    target = items
                    for name in path.split("."):
                        target = target[name]
                    # A pair may have more slots than these records have points.
                    values = arrays[path][records.run][rows]
                    target[...] = values[:, : target.shape[1]] if target.ndim > 1 else values
            overlapping_view(data, layout.size)[starts[some]] = items.view(f"V{layout.size}")


class ChunkIndexes(NamedTuple):
    """The MessageIndex records of a chunk, and the start of each channel's among them."""

    data: bytes
    starts: Mapping[int, int]


def message_indexes(
    times: NDArray[np.uint64], sizes: Integers, offsets: Integers, cuts: Sequence[int]
) -> Iterator[ChunkIndexes]:
    """Yield the indexes of each chunk; chunks begin at all cuts except the last.

    Messages have these (rows, channels) sizes, at offsets from the start of all chunks.
    """
    is_used = sizes != 0
    channels, rows = np.nonzero(is_used.T)
    chunk_of_row = np.repeat(np.arange(len(cuts) - 1), np.diff(cuts))
    entries = np.empty((len(rows), 2), np.uint64)
    entries[:, 0] = times[rows]
    entries[:, 1] = offsets[rows, channels] - offsets[cuts[:-1], 0][chunk_of_row[rows]]
    data, entry_size = entries.data.cast("B"), 16  # of a time and an offset, each of 8 bytes
    # Entries are sorted by channel, then by chunk.
    counts = np.add.reduceat(is_used, cuts[:-1], axis=0, dtype=np.int64).T
    ends = (np.cumsum(counts).reshape(counts.shape) * entry_size).tolist()
    for chunk, lengths in enumerate((counts.T * entry_size).tolist()):
        parts, starts, size = list[bytes](), dict[int, int](), 0
        for channel, length in enumerate(lengths, start=1):
            if length:
                end = ends[channel - 1][chunk]
                head = INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, 6 + length, channel, length)
                parts.append(head + data[end - length : end].tobytes())
                starts[channel], size = size, size + len(parts[-1])
        yield ChunkIndexes(b"".join(parts), starts)


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


def unpack_values(data: Bytes, items: Items, width: int, places: Rows) -> None:
    """Set the numbers of one width in records, from their bytes in a block; see `pack_values`."""
    library, count = _load_library() if is_wanted() else None, len(items)
    if library is None:
        planes = np.ascontiguousarray(data.reshape(width, -1).T)
        folded = planes.view(f"<u{width}")
        numbers = np.bitwise_xor(folded >> 1, np.negative(folded & 1)).reshape(-1, count).T
        for _ in range(2):
            numbers = np.cumsum(numbers, axis=0, dtype=numbers.dtype)
        overlapping_numbers(items, width)[:, places] = numbers
        return
    columns, sums = np.array(places, np.int64), np.zeros((len(places), 2), np.uint64)
    library.unpack_values(
        data.ctypes.data,
        count,
        width,
        len(columns),
        columns.ctypes.data,
        sums.ctypes.data,
        items.ctypes.data,
        items.dtype.itemsize,
    )


def overlapping_view(data: Bytes, size: int) -> NDArray[np.void]:
    """Return a view with the `size` bytes that start at byte i as item i."""
    return np.ndarray((max(len(data) - size + 1, 0),), f"V{size}", data, strides=(1,))


def overlapping_numbers(items: Items, width: int) -> Unsigned:
    """Return a view with the number that starts at byte j of record i as item (i, j)."""
    size = items.dtype.itemsize
    shape = len(items), size - width + 1
    return np.ndarray(shape, f"<u{width}", items.view(np.uint8), strides=(size, 1))
