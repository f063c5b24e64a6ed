"""The structural check accepts sound files of any writer and finds each planted defect."""

import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.writer import CompressionType, IndexType, Writer
from tests.written_traces import write_trace

from contactlab.contact.trace_arrays import PairSeries, Trace
from contactlab.store.mcap import file_parts
from contactlab.store.mcap.mcap_check import check_trace
from contactlab.store.mcap.trace_writer import TraceExtras

MakeTrace = Callable[..., tuple[Trace, list[PairSeries]]]


@pytest.mark.parametrize("steps", [0, 1, 50])
@pytest.mark.parametrize("chunk_size", [1, 2000, file_parts.CHUNK_SIZE])
def test_our_files_are_sound(
    tmp_path: Path, make_trace: MakeTrace, extras: TraceExtras, steps: int, chunk_size: int
) -> None:
    trace, series = make_trace(pairs=("a-b", "c-d"), steps=steps, momentum=True)
    with patch.object(file_parts, "CHUNK_SIZE", chunk_size):
        write_trace(tmp_path / "trace.mcap", trace, 0, series, extras)
    assert check_trace(tmp_path / "trace.mcap") == []


def foreign(path: Path, times: tuple[int, ...] = (0, 5, 5, 9), **options: Any) -> list[str]:
    """Write a file with the package's own writer and return what the check says of it."""
    defaults: dict[str, Any] = {
        "compression": CompressionType.NONE,
        "chunk_size": 60,
        "enable_data_crcs": True,
    }
    writer = Writer(str(path), **(defaults | options))
    writer.start()
    schema = writer.register_schema("Thing", "jsonschema", b'{"type": "object"}')
    channels = [writer.register_channel(topic, "json", schema) for topic in ("/a", "/b")]
    for number, time in enumerate(times):
        writer.add_message(channels[number % 2], time, b'{"x": 1}', time)
    writer.add_attachment(0, 0, "model.xml", "application/xml", b"<mujoco/>")
    writer.add_metadata("run", {"seed": "0"})
    writer.finish()
    return check_trace(path)


@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.ZSTD])
def test_sound_files_of_another_writer_pass(tmp_path: Path, compression: CompressionType) -> None:
    assert foreign(tmp_path / "trace.mcap", compression=compression) == []


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"index_types": IndexType.ALL & ~IndexType.CHUNK}, "ChunkIndex records do not match"),
        ({"index_types": IndexType.ALL & ~IndexType.METADATA}, "MetadataIndex records do not"),
        ({"index_types": IndexType.ALL & ~IndexType.ATTACHMENT}, "AttachmentIndex records do"),
        ({"index_types": IndexType.ALL & ~IndexType.MESSAGE}, "has messages but no message index"),
        ({"use_statistics": False}, "0 Statistics records"),
        ({"use_summary_offsets": False}, "summary offsets do not point"),
        ({"repeat_channels": False}, "channels are not those of the data section"),
        ({"repeat_schemas": False}, "schemas are not those of the data section"),
        ({"use_chunking": False}, "lies outside of the chunks"),
        ({"enable_data_crcs": False}, "data section does not match its checksum"),
        ({"enable_crcs": False}, "summary does not match its checksum"),
        ({"times": (0, 9, 5)}, "a message of 5 ns lies after one of 9 ns"),
        ({"compression": CompressionType.LZ4}, "compression 'lz4'"),
    ],
    ids=str,
)
def test_what_a_writer_left_out_is_found(
    tmp_path: Path, options: dict[str, Any], problem: str
) -> None:
    if options.get("compression") is CompressionType.LZ4:
        pytest.importorskip("lz4")
    problems = foreign(tmp_path / "trace.mcap", **options)
    assert any(problem in each for each in problems), problems


def test_a_file_without_a_summary_is_found(tmp_path: Path) -> None:
    problems = foreign(
        tmp_path / "trace.mcap",
        index_types=IndexType.NONE,
        repeat_channels=False,
        repeat_schemas=False,
        use_statistics=False,
        use_summary_offsets=False,
    )
    assert problems == ["the summary is missing"]


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


# Offsets of a number within a record's content, by https://mcap.dev/spec, and what the check says
# when the number is one more than it should be.
PLANTED = [
    (Opcode.STATISTICS, 0, "the statistics say message_count is"),
    (Opcode.STATISTICS, 8, "the statistics say schema_count is"),
    (Opcode.STATISTICS, 22, "the statistics say chunk_count is"),
    (Opcode.STATISTICS, 34, "the statistics say message_end_time is"),
    (Opcode.STATISTICS, 48, "the statistics say channel_message_counts is"),
    (Opcode.MESSAGE_INDEX, 0, "no message index"),
    (Opcode.MESSAGE_INDEX, 6, "does not point at its messages"),
    (Opcode.MESSAGE_INDEX, 14, "does not point at its messages"),
    (Opcode.CHUNK, 0, "its time span is not that of its messages"),
    (Opcode.CHUNK, 24, "its content does not match its checksum"),
    (Opcode.CHUNK_INDEX, 16, "ChunkIndex records do not match"),
    (Opcode.CHUNK_INDEX, 38, "ChunkIndex records do not match"),
    (Opcode.ATTACHMENT, 21, "does not match its checksum"),
    (Opcode.ATTACHMENT_INDEX, 0, "AttachmentIndex records do not match"),
    (Opcode.METADATA_INDEX, 0, "MetadataIndex records do not match"),
    (Opcode.SUMMARY_OFFSET, 1, "the summary offsets do not point"),
    (Opcode.CHANNEL, 2, "channels are not those of the data section"),
    (Opcode.DATA_END, -9, "does not end right before the summary"),
    (Opcode.FOOTER, -9, "the footer is damaged"),
]


@pytest.mark.parametrize(("opcode", "offset", "problem"), PLANTED)
def test_a_planted_defect_is_found(
    tmp_path: Path,
    make_trace: MakeTrace,
    extras: TraceExtras,
    opcode: Opcode,
    offset: int,
    problem: str,
) -> None:
    path = tmp_path / "trace.mcap"
    trace, series = make_trace(pairs=("a-b",), steps=30)
    write_trace(path, trace, 0, series, extras)
    file = bytearray(path.read_bytes())
    file[places(file, opcode)[0] + offset] += 1
    path.write_bytes(reseal(file))
    problems = check_trace(path)
    assert any(problem in each for each in problems), problems


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
    path.write_bytes(flipped if flip else file[:place])
    assert check_trace(path) != []


def test_a_missing_file_is_a_problem(tmp_path: Path) -> None:
    assert check_trace(tmp_path / "absent.mcap") == ["cannot be read: No such file or directory"]
