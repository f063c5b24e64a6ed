"""Columns of numbers as text in a page: shuffled bytes, gzip, base64."""

import base64
import gzip
import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats

_LEVEL = 6  # 9 takes six times as long, and saves 1 % of a large page
_MANTISSA = 23


def pack_columns(columns: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """Return columns of numbers in a form that JSON holds.

    Bytes are ordered by significance, all first bytes of a column first: neighbors are alike,
    which compresses well. The same columns give the same text.
    """
    names: list[list[object]] = []
    stream = bytearray()
    for name, column in columns.items():
        kind = column.dtype.str[1:]
        names.append([name, kind, column.size])
        values = np.ascontiguousarray(column, dtype=f"<{kind}")
        stream += values.view(np.uint8).reshape(-1, values.itemsize).T.tobytes()
    packed = gzip.compress(stream, _LEVEL, mtime=0)
    return {"columns": names, "bytes": base64.b64encode(packed).decode()}


def packed_text(text: str) -> str:
    """Return text as gzip in base64; the same text gives the same."""
    return base64.b64encode(gzip.compress(text.encode(), _LEVEL, mtime=0)).decode()


def packed_integers(values: NDArray[Any]) -> NDArray[Any]:
    """Return non-negative integers in as few bytes as they need."""
    most = int(values.max()) if values.size else 0
    return values.astype("u1" if most < 1 << 8 else "u2" if most < 1 << 16 else "u4")


def rounded_floats(values: Floats, bits: int = _MANTISSA) -> NDArray[np.float32]:
    """Return numbers in single precision, rounded to some bits of mantissa.

    Bits that are rounded away are zero and cost nothing once compressed. The relative error is at
    most 2^-(bits + 1).
    """
    with np.errstate(over="ignore"):
        single = values.astype(np.float32)
    if bits >= _MANTISSA:
        return single
    drop = _MANTISSA - bits
    raw = single.view(np.uint32)
    rounded = (raw + np.uint32(1 << (drop - 1))) & ~np.uint32((1 << drop) - 1)
    return np.where(np.isfinite(single), rounded.view(np.float32), single)


def run_id_halves(run_ids: NDArray[np.uint64]) -> NDArray[np.uint32]:
    """Return (2 n,) the halves of run ids (n,), the higher one first."""
    return run_ids.astype(">u8").view(">u4").astype("u4")


def as_json(data: Any) -> str:  # noqa: ANN401 - anything that JSON holds
    """Return data as JSON that cannot end its script element; NaN and infinities become null."""
    text = json.dumps(
        _replace_infinite(data), allow_nan=False, separators=(",", ":"), ensure_ascii=True
    )
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _replace_infinite(data: Any) -> Any:  # noqa: ANN401
    if isinstance(data, float):
        return data if math.isfinite(data) else None
    if isinstance(data, dict):
        return {str(key): _replace_infinite(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_replace_infinite(item) for item in data]
    return data
