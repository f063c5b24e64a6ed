"""Exchanges numbers and scalars between Arrow and NumPy by their bytes.

`pa.array`, `pa.scalar` and `to_numpy` check for pandas objects, and for that import pandas wherever
it is installed, which takes a third of a second.
"""

from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray


def number_array(values: NDArray[np.number]) -> pa.Array:
    """Return (n,) integers or floats as an array of Arrow, without nulls."""
    contiguous = np.ascontiguousarray(values)
    kind = pa.from_numpy_dtype(contiguous.dtype)
    return pa.Array.from_buffers(kind, len(contiguous), [None, pa.py_buffer(contiguous)])


def zero_scalar(kind: pa.DataType) -> pa.Scalar:
    """Return zero of a kind of numbers, or False."""
    return pa.Array.from_buffers(kind, 1, [None, pa.py_buffer(bytes(8))])[0]


def text_scalar(text: str) -> pa.Scalar:
    """Return a text as an Arrow scalar."""
    content = text.encode()
    ends = pa.py_buffer(np.array([0, len(content)], np.int32))
    return pa.Array.from_buffers(pa.string(), 1, [None, ends, pa.py_buffer(content)])[0]


def numpy_array(column: pa.Array | pa.ChunkedArray) -> NDArray[Any]:
    """Return the (n,) numbers or booleans of a column; entries at nulls are arbitrary."""
    if isinstance(column, pa.ChunkedArray):
        kind = _number_type(column.type)
        return np.concatenate([np.empty(0, kind), *map(numpy_array, column.chunks)])
    _, values = column.buffers()
    start, stop = column.offset, column.offset + len(column)
    if not len(column) or values is None:
        return np.zeros(len(column), _number_type(column.type))
    if pa.types.is_boolean(column.type):
        bits = np.unpackbits(np.frombuffer(values, np.uint8), count=stop, bitorder="little")
        return bits[start:].view(np.bool_)
    return np.frombuffer(values, _number_type(column.type))[start:stop]


def _number_type(kind: pa.DataType) -> np.dtype[Any]:
    if pa.types.is_boolean(kind):
        return np.dtype(np.bool_)
    family = "f" if pa.types.is_floating(kind) else "i" if pa.types.is_signed_integer(kind) else "u"
    return np.dtype(f"{family}{kind.bit_width // 8}")
