"""Packed columns come back as they were, by the slow obvious way of unpacking them."""

import base64
import gzip
import json
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from contactlab.page.packing import (
    as_json,
    pack_columns,
    packed_integers,
    rounded_floats,
    run_id_halves,
)

KINDS = {"u1": "<u1", "u2": "<u2", "u4": "<u4", "f4": "<f4", "f8": "<f8"}


def unpack(packed: dict[str, Any]) -> dict[str, NDArray[Any]]:
    stream = gzip.decompress(base64.b64decode(packed["bytes"]))
    found: dict[str, NDArray[Any]] = {}
    start = 0
    for name, kind, length in packed["columns"]:
        width = int(kind[1])
        raw = bytearray(width * length)
        for place in range(width):
            for index in range(length):
                raw[index * width + place] = stream[start + place * length + index]
        found[name] = np.frombuffer(bytes(raw), KINDS[kind])
        start += width * length
    assert start == len(stream)
    return found


@given(
    st.lists(st.floats(width=32), max_size=40),
    st.lists(st.integers(0, 2**32 - 1), max_size=40),
    st.lists(st.floats(), max_size=40),
)
def test_columns_come_back(singles: list[float], places: list[int], doubles: list[float]) -> None:
    columns = {
        "singles": rounded_floats(np.array(singles, dtype=np.float64)),
        "places": packed_integers(np.array(places, dtype=np.int64)),
        "doubles": np.array(doubles, dtype=np.float64),
    }
    found = unpack(json.loads(json.dumps(pack_columns(columns))))
    for name, column in columns.items():
        assert found[name].dtype == column.dtype
        np.testing.assert_array_equal(found[name], column)


def test_the_same_columns_give_the_same_text() -> None:
    column = {"a": np.linspace(0, 1, 1000)}
    assert pack_columns(column) == pack_columns(column)


@given(st.floats(2.0**-100, 2.0**100), st.integers(4, 23))
def test_rounding_keeps_so_many_bits(value: float, bits: int) -> None:
    """Rounding to b bits of mantissa is off by half of the last one at most: 2^-(b + 1).

    Rounding to single precision before that adds 2^-24.
    """
    (kept,) = rounded_floats(np.array([value, -value]), bits)[:1].tolist()
    assert abs(kept - value) <= value * (2.0 ** -(bits + 1) + 2.0**-24)
    (other,) = rounded_floats(np.array([-value]), bits).tolist()
    assert other == -kept


def test_nan_and_infinities_stay_what_they_are() -> None:
    kept = rounded_floats(np.array([math.nan, math.inf, -math.inf, 0.0, 1e300]), 9)
    assert np.isnan(kept[0])
    assert kept[1:].tolist() == [math.inf, -math.inf, 0.0, math.inf]


def test_ids_come_back() -> None:
    runs = ["0123456789abcdef", "ffffffffffffffff", "0000000000000001"]
    numbers = np.array([int(run, 16) for run in runs], np.uint64)
    halves = run_id_halves(numbers).reshape(-1, 2).tolist()
    assert [f"{high:08x}{low:08x}" for high, low in halves] == runs


@pytest.mark.parametrize("text", ["</script><b>", "<!--", "a & b", "\u2028", 'say "no"'])
def test_json_cannot_end_its_script(text: str) -> None:
    encoded = as_json({"text": [text, float("nan")]})
    assert not set("<>&\u2028") & set(encoded)
    assert json.loads(encoded) == {"text": [text, None]}
