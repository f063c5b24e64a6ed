"""Message records, indexes of chunks and values of blocks, written by functions in C or by NumPy.

Both leave the same bytes. NumPy fills the records of a group column by column, then scatters them
over the chunks; `record_encoder.c` writes each to its place.
"""

import ctypes
import struct
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from contactlab.native import agrees, functions_of
from contactlab.store.mcap.scratch import SCRATCH
from contactlab.store.mcap.trace_messages import MessageLayout

Bytes = NDArray[np.uint8]
Rows = NDArray[np.intp]
Integers = NDArray[np.int64]
Items = NDArray[np.void]
Unsigned = NDArray[np.unsignedinteger]

_SINGLE = np.dtype("<f4")
_SOURCE = Path(__file__).with_suffix(".c")
INDEX_HEAD = struct.Struct("<BQHI")
_ENTRY_SIZE = 16


class Values:
    """The numbers that go into messages, by the path of their field in a record.

    Each array is (n, N, ...), for n runs and N rows; the other axes are the field's, or longer.
    """

    def __init__(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        self.arrays = dict(arrays)
        self._tables: dict[MessageLayout, Integers] = {}

    def table(self, layout: MessageLayout) -> Integers:
        """Return (fields, 5) addresses and strides of what a layout's fields hold."""
        if layout not in self._tables:
            found = [self._source(path, field.kind) for path, field in layout.fields.items()]
            self._tables[layout] = np.array(found, np.int64)
        return self._tables[layout]

    def _source(self, path: str, kind: np.dtype[Any]) -> list[int]:
        exact = np.dtype(np.float64) if kind == _SINGLE else kind
        array = self.arrays[path] = np.asarray(self.arrays[path], exact)
        run, row, *others = array.strides
        return [_at(array), run, row, *[0] * (2 - len(others)), *others]


class Records(NamedTuple):
    """Message records of one channel and one length, in ascending rows of one run."""

    channel: int
    rows: Rows
    layout: MessageLayout
    values: Values
    run: int


class RecordEncoder:
    """By NumPy."""

    def write(self, records: Records, data: Bytes, starts: Integers) -> None:
        """Write records to where they start (m,) in a buffer."""
        _, rows, layout, values, run = records
        items = layout.fill(SCRATCH.take("records", len(rows) * layout.size))
        with np.errstate(over="ignore"):
            for path, field in layout.fields.items():
                target = items
                for name in path.split("."):
                    target = target[name]
                each = values.arrays[path][run, span_of(rows)]
                target[...] = each[(slice(None), *map(slice, field.shape))]
        overlapping(data, layout.size)[starts] = items.view(f"V{layout.size}")

    def indexes(
        self, times: NDArray[np.uint64], sizes: Integers, offsets: Integers
    ) -> tuple[bytes, list[int]]:
        """Return the MessageIndex records of a chunk, and their lengths, 0 without messages.

        It has messages of these (rows, channels) sizes at offsets from the start of all chunks.
        """
        found = [
            _index(channel, times[used], offsets[used, channel - 1] - offsets[0, 0])
            for channel, column in enumerate(sizes.T, start=1)
            for used in [np.flatnonzero(column)]
        ]
        return b"".join(found), [*map(len, found)]

    def pack(self, records: Bytes, layout: MessageLayout, data: Bytes) -> None:
        """Write the values of records to a buffer as a block has them, width by width."""
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


class NativeEncoder(RecordEncoder):
    """By functions in C."""

    def __init__(self, library: ctypes.CDLL) -> None:
        pointer, size = ctypes.c_void_p, ctypes.c_int64
        self._library, sizes = library, (size, size)
        layout = ctypes.c_char_p, size, pointer, pointer, size
        library.write_records.argtypes = *layout, size, pointer, size, pointer, pointer, size
        library.write_indexes.argtypes = (*(pointer,) * 3, *sizes, pointer, pointer)
        library.write_planes.argtypes = pointer, *sizes, pointer, *sizes, pointer

    def write(self, records: Records, data: Bytes, starts: Integers) -> None:  # noqa: D102
        _, rows, layout, values, run = records
        sources = values.table(layout)
        described = layout.template, layout.size, _fields(layout)[1], _at(sources), len(sources)
        places = _at(data), _at(starts), starts.strides[0]
        self._library.write_records(*described, run, _at(rows), len(rows), *places)

    def indexes(  # noqa: D102
        self, times: NDArray[np.uint64], sizes: Integers, offsets: Integers
    ) -> tuple[bytes, list[int]]:
        rows, channels = sizes.shape
        out = SCRATCH.take("indexes", rows * channels * _ENTRY_SIZE + channels * INDEX_HEAD.size)
        lengths = np.empty(channels, np.int64)
        given = [*map(np.ascontiguousarray, (times, sizes, offsets))]
        self._library.write_indexes(*map(_at, given), rows, channels, _at(out), _at(lengths))
        found = lengths.tolist()
        return out[: sum(found)].tobytes(), found

    def pack(self, records: Bytes, layout: MessageLayout, data: Bytes) -> None:  # noqa: D102
        count, start = len(records) // layout.size, _at(data)
        for width, places in layout.values:
            columns = _at(places), len(places), width
            self._library.write_planes(_at(records), count, layout.size, *columns, start)
            start += count * len(places) * width


@cache
def _fields(layout: MessageLayout) -> tuple[Integers, int]:
    """Return (fields, 7) start, two axes' lengths and strides, width, and whether it is single."""
    found: list[list[int]] = []
    for kind, start, shape, strides in layout.fields.values():
        missing = 2 - len(shape)
        axes = *[1] * missing, *shape, *[0] * missing, *strides
        found.append([start, *axes, kind.itemsize, kind == _SINGLE])
    table = np.array(found, np.int64)
    return table, _at(table)  # NumPy takes a microsecond to say where an array lies.


def record_encoder() -> RecordEncoder:
    """Return what writes records here."""
    library = functions_of(_SOURCE)
    return _native(library) if library else _NUMPY


def as_numpy_writes(encode: Callable[[], bytes]) -> bytes:
    """Return a file; the first that functions in C write in a process is held against NumPy's."""
    in_numpy = functions_of(_SOURCE) is None
    content = encode()
    return content if in_numpy or agrees(_SOURCE, lambda: content, encode) else encode()


_NUMPY = RecordEncoder()
_native = cache(NativeEncoder)


def span_of(rows: Rows) -> Rows | slice:
    """Return rows as a slice where they are consecutive, which indexes without a copy."""
    consecutive = len(rows) > 0 and rows[-1] - rows[0] == len(rows) - 1
    return slice(int(rows[0]), int(rows[-1]) + 1) if consecutive else rows


def overlapping(data: Bytes, size: int) -> NDArray[np.void]:
    """Return a view whose item i is the `size` bytes that start at byte i."""
    return np.ndarray((max(len(data) - size + 1, 0),), f"V{size}", data, strides=(1,))


def overlapping_numbers(items: Items, width: int) -> Unsigned:
    """Return a view of which item (i, j) is the number from byte j of record i on."""
    size = items.dtype.itemsize
    shape = len(items), size - width + 1
    return np.ndarray(shape, f"<u{width}", items.view(np.uint8), strides=(size, 1))


def _index(channel: int, times: NDArray[np.uint64], offsets: Integers) -> bytes:
    """Return a MessageIndex record; empty where there is no message."""
    if not len(times):
        return b""
    length = len(times) * _ENTRY_SIZE
    head = INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, 6 + length, channel, length)
    return head + np.column_stack((times, offsets.astype(np.uint64))).tobytes()


def _at(array: NDArray[Any]) -> int:
    return array.ctypes.data
