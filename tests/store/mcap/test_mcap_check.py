"""The structural check accepts the files that are written, and finds each planted defect."""

import struct
import zlib
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from tests.written_traces import TraceExtras, assert_viewable, find_defect, write_trace

from contactlab.contact.trace_arrays import PairSeries, Trace
from contactlab.store.mcap import file_parts, trace_writer

MakeTrace = Callable[..., tuple[Trace, list[PairSeries]]]


@pytest.mark.parametrize("steps", [0, 1, 50])
@pytest.mark.parametrize("chunk_size", [1, 2000, file_parts.CHUNK_SIZE])
def test_our_files_are_sound(
    tmp_path: Path, make_trace: MakeTrace, extras: TraceExtras, steps: int, chunk_size: int
) -> None:
    trace, series = make_trace(pairs=("a-b", "c-d"), steps=steps, momentum=True)
    with patch.object(file_parts, "CHUNK_SIZE", chunk_size):
        write_trace(tmp_path / "trace.mcap", trace, 0, series, extras)
    assert find_defect((tmp_path / "trace.mcap").read_bytes()) is None
    assert_viewable(tmp_path / "trace.mcap")


def reseal(file: bytearray) -> bytes:
    """Make both checksums fit again, so that only the planted defect is left."""
    end = len(file) - 8
    [summary_start] = struct.unpack_from("<Q", file, end - 20)
    struct.pack_into("<I", file, summary_start - 4, zlib.crc32(file[: summary_start - 13]))
    struct.pack_into("<I", file, end - 4, zlib.crc32(file[summary_start : end - 4]))
    return bytes(file)


def places(file: bytearray, opcode: Opcode) -> list[int]:
    """Return where the content of each record of a kind starts."""
    found: list[int] = []
    position = 8
    while position < len(file) - 8:
        kind, length = struct.unpack_from("<BQ", file, position)
        if kind == opcode:
            found.append(position + 9)
        position += 9 + length
    return found


# Offsets of a number within a record's content, by https://mcap.dev/spec, which is made one more
# than it should be.
PLANTED = [
    (Opcode.HEADER, 4),
    (Opcode.STATISTICS, 0),
    (Opcode.STATISTICS, 8),
    (Opcode.STATISTICS, 22),
    (Opcode.STATISTICS, 34),
    (Opcode.STATISTICS, 48),
    (Opcode.MESSAGE_INDEX, 0),
    (Opcode.MESSAGE_INDEX, 6),
    (Opcode.MESSAGE_INDEX, 14),
    (Opcode.CHUNK, 0),
    (Opcode.CHUNK, 24),
    (Opcode.CHUNK_INDEX, 16),
    (Opcode.CHUNK_INDEX, 38),
    (Opcode.ATTACHMENT, 21),
    (Opcode.ATTACHMENT_INDEX, 0),
    (Opcode.METADATA_INDEX, 0),
    (Opcode.SUMMARY_OFFSET, 1),
    (Opcode.CHANNEL, 2),
    (Opcode.DATA_END, -9),
    (Opcode.FOOTER, -9),
    (Opcode.FOOTER, 8),
]


@pytest.mark.parametrize(("opcode", "offset"), PLANTED)
def test_a_planted_defect_is_found(
    tmp_path: Path, make_trace: MakeTrace, extras: TraceExtras, opcode: Opcode, offset: int
) -> None:
    path = tmp_path / "trace.mcap"
    trace, series = make_trace(pairs=("a-b",), steps=30)
    write_trace(path, trace, 0, series, extras)
    file = bytearray(path.read_bytes())
    file[places(file, opcode)[0] + offset] += 1
    assert find_defect(reseal(file))


def test_a_record_that_is_left_out_is_found(
    tmp_path: Path, make_trace: MakeTrace, extras: TraceExtras
) -> None:
    path = tmp_path / "trace.mcap"
    trace, series = make_trace(pairs=("a-b", "c-d"), steps=30)
    write_trace(path, trace, 0, series, extras)
    file = path.read_bytes()
    starts = sorted(start - 9 for kind in Opcode for start in places(bytearray(file), kind))
    for start, stop in pairwise(starts):
        left = bytearray(file[:start] + file[stop:])
        for at in (-28, -20):
            [section] = struct.unpack_from("<Q", left, len(left) + at)
            if section > start:
                struct.pack_into("<Q", left, len(left) + at, section - (stop - start))
        assert find_defect(reseal(left)), file[start]


@pytest.mark.parametrize("times", [(0, 9, 5), (5, 0, 9), (0, 5, 5)])
def test_messages_out_of_order_are_found(
    tmp_path: Path, make_trace: MakeTrace, extras: TraceExtras, times: tuple[int, ...]
) -> None:
    """Also where indexes and statistics are those of the messages as they lie."""
    trace, series = make_trace(pairs=(), steps=2)
    given = np.array([times], np.uint64), [True]
    with patch.object(trace_writer, "_log_times", lambda _: given):
        write_trace(tmp_path / "trace.mcap", trace, 0, series, extras)
    defect = find_defect((tmp_path / "trace.mcap").read_bytes())
    assert defect is not None
    assert "not in order of time" in defect


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_every_flipped_byte_and_every_cut_is_found(
    tmp_path_factory: pytest.TempPathFactory,
    make_trace: MakeTrace,
    extras: TraceExtras,
    data: st.DataObject,
) -> None:
    path = tmp_path_factory.getbasetemp() / "damaged_check.mcap"
    trace, series = make_trace(steps=3)
    write_trace(path, trace, 0, series, extras)
    file = path.read_bytes()
    place = data.draw(st.integers(0, len(file) - 1))
    flip = data.draw(st.integers(0, 255))
    flipped = file[:place] + bytes([file[place] ^ flip]) + file[place + 1 :]
    assert find_defect(flipped if flip else file[:place])
