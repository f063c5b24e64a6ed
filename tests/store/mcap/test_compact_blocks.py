"""The compact form gives every message again, and refuses blocks that are none."""

import struct
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.random_traces import trace_sizes
from tests.written_traces import TraceExtras, assert_viewable, find_defect

from contactlab.contact.trace_arrays import PairSeries, Trace
from contactlab.errors import StoreError
from contactlab.store.mcap import compact_blocks, file_parts
from contactlab.store.mcap.compact_blocks import expand_file
from contactlab.store.mcap.file_parts import encode_file, interleave_groups
from contactlab.store.mcap.message_encoder import single_message
from contactlab.store.mcap.stored_messages import file_start_of, find_damage, stored_file
from contactlab.store.mcap.trace_reader import read_trace
from contactlab.store.mcap.trace_writer import TraceEncoder

MakeTrace = Callable[..., tuple[Trace, list[PairSeries]]]
HEAD = struct.Struct("<IId")


@pytest.mark.long
@settings(max_examples=80, deadline=None)
@given(
    sizes=trace_sizes(steps=30, runs=2),
    block_size=st.sampled_from([1, 700, compact_blocks.BLOCK_SIZE]),
    chunk_size=st.sampled_from([1, 700, file_parts.CHUNK_SIZE]),
)
def test_blocks_expand_to_the_messages_byte_for_byte(
    make_trace: MakeTrace,
    extras: TraceExtras,
    sizes: dict[str, Any],
    block_size: int,
    chunk_size: int,
) -> None:
    trace, series = make_trace(**sizes)
    run = sizes["runs"] - 1
    messages, counts = TraceEncoder(trace, series).encode_run(run, *extras)
    with (
        patch.object(compact_blocks, "BLOCK_SIZE", block_size),
        patch.object(file_parts, "CHUNK_SIZE", chunk_size),
    ):
        compact, same_counts = TraceEncoder(trace, series).encode_run(run, *extras, form="compact")
    assert find_defect(compact) is None
    assert expand_file(compact) == messages
    assert counts == same_counts
    assert expand_file(messages) is messages


def test_viewers_find_blocks_in_order_of_time(
    tmp_path: Path, make_trace: MakeTrace, extras: TraceExtras
) -> None:
    trace, series = make_trace(pairs=("a-b", "c-d"), steps=200, momentum=True)
    with patch.object(compact_blocks, "BLOCK_SIZE", 9000):
        content, _ = TraceEncoder(trace, series).encode_run(0, *extras, form="compact")
    (tmp_path / "trace.mcap").write_bytes(content)
    assert_viewable(tmp_path / "trace.mcap")


def test_smooth_motion_takes_a_third(make_trace: MakeTrace, extras: TraceExtras) -> None:
    """Of 60 numbers a step that grow linearly, second differences leave rounding: a byte or two."""
    trace, series = make_trace(pairs=(), steps=2000, nq=30, nv=30)
    grown = np.arange(2001)[None, :, None] * np.linspace(0.1, 1, 30) * 1e-3 + 1.0
    still = np.ones((1, 2000))
    smooth = replace(
        trace, qpos=grown, qvel=grown, kinetic=still, potential=still, least_distance=still
    )
    messages, _ = TraceEncoder(smooth, series).encode_run(0, *extras)
    compact, _ = TraceEncoder(smooth, series).encode_run(0, *extras, form="compact")
    assert 3 * len(compact) < len(messages)


def test_a_block_is_what_the_format_says(make_trace: MakeTrace, extras: TraceExtras) -> None:
    """By an obvious loop over the integers of its first group, whose first column is log time."""
    trace, series = make_trace(nq=2, nv=1, pairs=(), steps=7)
    [block] = blocks(
        TraceEncoder(trace, series).encode_run(0, *extras, form="compact")[0], channel=1
    )
    count, _, timestep = HEAD.unpack_from(block)
    assert (count, timestep) == (7, trace.timestep[0])
    # Eight bytes each: log time, time, two positions, a velocity, three numbers of the step.
    planes, columns = block[HEAD.size :], []
    for column in range(8):
        values = [0, 0]
        for row in range(count):
            at = column * count + row
            folded = sum(planes[at + place * 8 * count] << 8 * place for place in range(8))
            second = folded >> 1 if folded % 2 == 0 else -(folded >> 1) - 1
            values.append((second + 2 * values[-1] - values[-2]) % 2**64)
        columns.append(values[2:])
    assert columns[0] == [round(each * 1e9) for each in trace.time[0, :7]]
    assert columns[1] == trace.time[0, :7].view(np.uint64).tolist()
    assert columns[2] == trace.qpos[0, :7, 0].copy().view(np.uint64).tolist()
    assert columns[4] == trace.qvel[0, :7, 0].copy().view(np.uint64).tolist()
    assert columns[7] == trace.least_distance[0].view(np.uint64).tolist()


def blocks(content: bytes, channel: int) -> list[bytes]:
    return list(stored_file(content).messages[channel].iterate_contents())


def with_blocks(content: bytes, changed: Sequence[Sequence[bytes]]) -> bytes:
    """Return a file with sound checksums and these blocks, by channel, then by time."""
    file = stored_file(content)
    times = file.messages[1].heads["log_time"]
    groups = [
        single_message(channel, row, int(times[row]), block)
        for channel, each in enumerate(changed, start=1)
        for row, block in enumerate(each)
    ]
    return encode_file(file_start_of(file), interleave_groups(groups, len(changed), times))


def refused(path: Path, content: bytes) -> str:
    path.write_bytes(content)
    assert find_damage(content) is None, "its checksums are sound"
    assert find_defect(content) is not None
    with pytest.raises(StoreError) as caught:
        read_trace(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.fixture
def compact(make_trace: MakeTrace, extras: TraceExtras) -> list[bytes]:
    """The file, the block of states, that of a pair, and the record of a short run."""
    trace, series = make_trace(pairs=("a-b",), steps=40, seed=1)
    content, _ = TraceEncoder(trace, series).encode_run(0, *extras, form="compact")
    return [content, *(block for channel in (1, 2, 3) for block in blocks(content, channel))]


def test_files_are_written_again_as_they_were(compact: list[bytes]) -> None:
    content, *parts = compact
    assert with_blocks(content, [[each] for each in parts]) == content


@pytest.mark.parametrize(
    ("head", "message"),
    [
        ((0, 200, 1e-3), "claims more messages than it holds"),
        ((2**31, 200, 1e-3), "claims more messages than it holds"),
        ((1, 2**31, 1e-3), "claims more messages than it holds"),
        ((10, 77, 1e-3), "a contact message has another layout"),
    ],
)
def test_a_head_that_says_something_else_is_refused(
    tmp_path: Path, compact: list[bytes], head: tuple[int, int, float], message: str
) -> None:
    content, states, pair, record = compact
    bent = HEAD.pack(*head) + pair[HEAD.size :]
    said = refused(tmp_path / "bent.mcap", with_blocks(content, [[states], [bent], [record]]))
    assert message in said


def test_blocks_that_are_cut_repeated_or_left_out_are_refused(
    tmp_path: Path, compact: list[bytes]
) -> None:
    content, states, pair, record = compact
    path = tmp_path / "bent.mcap"
    for bent in ([states[:-1], pair], [states, pair[:-1]], [states, pair + b"\0"]):
        refused(path, with_blocks(content, [[each] for each in (*bent, record)]))
    twice = with_blocks(content, [[states], [pair + pair], [record]])
    assert "two messages of one time" in refused(path, twice)
    again = with_blocks(content, [[states + states], [pair], [record]])
    assert "not in order of time" in refused(path, again)
    alien = pair[: HEAD.size] + b"\2" + pair[HEAD.size + 1 :]  # its log times are one more
    assert "have no state" in refused(path, with_blocks(content, [[states], [alien], [record]]))


@pytest.mark.long
@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_a_bent_block_is_read_or_refused_in_one_line(
    tmp_path_factory: pytest.TempPathFactory,
    make_trace: MakeTrace,
    extras: TraceExtras,
    data: st.DataObject,
) -> None:
    """Whatever bytes a block has: nothing but a StoreError is raised."""
    trace, series = make_trace(pairs=("a-b",), steps=12, seed=2)
    content, _ = TraceEncoder(trace, series).encode_run(0, *extras, form="compact")
    parts = [blocks(content, channel) for channel in (1, 2, 3)]
    which = data.draw(st.integers(0, 1))
    block = bytearray(parts[which][0])
    for _ in range(data.draw(st.integers(1, 3))):
        block[data.draw(st.integers(0, len(block) - 1))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.sampled_from([len(block), data.draw(st.integers(1, len(block)))]))
    parts[which] = [bytes(block[:cut])]
    path = tmp_path_factory.getbasetemp() / "bent_block.mcap"
    path.write_bytes(with_blocks(content, parts))
    said = ""
    try:
        read_trace(path)
    except StoreError as error:
        said = str(error)
    assert "\n" not in said


def test_a_trace_of_many_blocks_is_read_as_one(
    tmp_path: Path, make_trace: MakeTrace, extras: TraceExtras
) -> None:
    trace, series = make_trace(pairs=("a-b",), steps=300, seed=3)
    with patch.object(compact_blocks, "BLOCK_SIZE", 5000):
        content, _ = TraceEncoder(trace, series).encode_run(0, *extras, form="compact")
    assert len(blocks(content, 1)) > 10
    (tmp_path / "trace.mcap").write_bytes(content)
    stored = read_trace(tmp_path / "trace.mcap")
    np.testing.assert_array_equal(stored.qvel, trace.qvel[0], strict=True)
    assert stored.record_json == extras.record_json
