"""Write a trace file and read it back by our own means."""

import hashlib
import resource
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import fields, replace
from itertools import pairwise
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer
from tests.random_traces import trace_sizes
from tests.written_traces import TraceExtras, write_trace

from contactlab.contact.trace_arrays import FOUND, PairSeries, Trace
from contactlab.errors import OutputError, StoreError
from contactlab.schema.vocabulary import TraceFormat
from contactlab.store.mcap import file_parts
from contactlab.store.mcap.trace_reader import StoredTrace, read_trace

MakeTrace = Callable[..., tuple[Trace, list[PairSeries]]]


def assert_stored(stored: StoredTrace, trace: Trace, run: int, series: list[PairSeries]) -> None:
    names = {each.name: each.name for each in fields(trace)} | {"angular_momentum": "spin"}
    for name, stored_name in names.items():
        if stored_name in {each.name for each in fields(stored)} - {"pairs"}:
            ours, source = getattr(stored, stored_name), getattr(trace, name)
            if source is None or (name.endswith("momentum") and trace.steps == 0):
                assert ours is None
            else:
                assert ours.dtype == source.dtype
                np.testing.assert_array_equal(ours, source[run], err_msg=name, strict=True)
    for pair, source, net in zip(stored.pairs, trace.pairs, series, strict=True):
        touching = source.touching[run]
        steps = np.flatnonzero(touching.any(axis=1))
        assert pair.name == source.name
        np.testing.assert_array_equal(pair.steps, steps)
        point_steps = np.repeat(pair.steps, pair.contacts)
        np.testing.assert_array_equal(point_steps, np.nonzero(touching)[0])
        with np.errstate(over="ignore"):
            single = source.slots[run][touching].astype(np.float32)
        np.testing.assert_array_equal(pair.points, single.astype(np.float64), strict=True)
        found = source.slots[run, steps, :, FOUND].max(axis=1, initial=0)
        np.testing.assert_array_equal(pair.found, found)
        for name in ("contacts", "mode", "normal", "tangential", "usage", "slip", "distance"):
            np.testing.assert_array_equal(
                getattr(pair, name), getattr(net, name)[run, steps], err_msg=name, strict=True
            )


@settings(max_examples=60, deadline=None)
@given(
    sizes=trace_sizes(steps=9, runs=3),
    chunk_size=st.sampled_from([1, 700, file_parts.CHUNK_SIZE]),
    form=st.sampled_from(["messages", "compact"]),
)
def test_what_is_read_is_what_was_written(
    tmp_path_factory: pytest.TempPathFactory,
    make_trace: MakeTrace,
    extras: TraceExtras,
    sizes: dict[str, Any],
    chunk_size: int,
    form: TraceFormat,
) -> None:
    trace, series = make_trace(**sizes)
    run = sizes["runs"] - 1
    path = tmp_path_factory.getbasetemp() / "round_trip.mcap"
    with patch.object(file_parts, "CHUNK_SIZE", chunk_size):
        summary = write_trace(path, trace, run, series, extras, form)
    stored = read_trace(path)
    assert_stored(stored, trace, run, series)
    assert stored.record_json == extras.record_json
    assert stored.metadata == extras.metadata
    assert stored.model_xml == extras.model_xml
    data = path.read_bytes()
    assert (summary.sha256, summary.size) == (hashlib.sha256(data).hexdigest(), len(data))


def test_equal_runs_give_equal_files(
    tmp_path: Path, make_trace: MakeTrace, extras: TraceExtras
) -> None:
    """Also when another, longer trace was written between them, whose memory is reused."""
    files: list[bytes] = []
    for seed, steps in ((1, 30), (2, 90), (1, 30)):
        trace, series = make_trace(seed=seed, steps=steps)
        write_trace(tmp_path / "trace.mcap", trace, 0, series, extras)
        files.append((tmp_path / "trace.mcap").read_bytes())
    assert files[0] == files[2]
    assert [each.name for each in tmp_path.iterdir()] == ["trace.mcap"]


def test_threads_do_not_share_memory(
    tmp_path: Path, make_trace: MakeTrace, extras: TraceExtras
) -> None:
    cases = [make_trace(seed=seed, steps=500 + 100 * seed) for seed in range(8)]

    def write(seed: int) -> str:
        trace, series = cases[seed]
        return write_trace(tmp_path / f"{seed}.mcap", trace, 0, series, extras).sha256

    alone = [write(seed) for seed in range(8)]
    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(write, range(8))) == alone


def test_chunks_are_near_one_mebibyte_and_never_split_a_time(
    tmp_path: Path, make_trace: MakeTrace, extras: TraceExtras
) -> None:
    trace, series = make_trace(nq=200, nv=200, pairs=("a-b", "c-d"), slots=4, steps=800)
    write_trace(tmp_path / "trace.mcap", trace, 0, series, extras)
    with (tmp_path / "trace.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    spans = [(each.message_start_time, each.message_end_time) for each in summary.chunk_indexes]
    assert all(before[1] < after[0] for before, after in pairwise(spans))
    sizes = [each.uncompressed_size for each in summary.chunk_indexes]
    # A row holds 400 coordinates and at most 8 contact points of 22 numbers: below 5 kB. A chunk
    # ends with the row that crosses a multiple of 1 MiB, so it is off by less than a row.
    assert len(sizes) > 2
    assert all(abs(size - 2**20) < 5_000 for size in sizes[:-1])
    assert_stored(read_trace(tmp_path / "trace.mcap"), trace, 0, series)


@pytest.mark.parametrize("time", [[0.0, 0.1, 0.1], [0.0, 0.1, np.nan], [-0.1, 0.0, 0.1]])
def test_time_must_grow_from_zero(
    tmp_path: Path, make_trace: MakeTrace, extras: TraceExtras, time: list[float]
) -> None:
    trace, series = make_trace(steps=2)
    trace = replace(trace, time=np.array([time]))
    with pytest.raises(OutputError, match="the run's time must not be negative"):
        write_trace(tmp_path / "trace.mcap", trace, 0, series, extras)
    assert list(tmp_path.iterdir()) == []


def test_steps_of_less_than_a_nanosecond_are_refused(
    tmp_path: Path, make_trace: MakeTrace, extras: TraceExtras
) -> None:
    trace, series = make_trace(steps=2)
    trace = replace(trace, time=np.array([[0.0, 1e-10, 2e-10]]))
    with pytest.raises(OutputError, match="grow by at least a nanosecond"):
        write_trace(tmp_path / "trace.mcap", trace, 0, series, extras)


def test_a_missing_folder_is_named(
    tmp_path: Path, make_trace: MakeTrace, extras: TraceExtras
) -> None:
    trace, series = make_trace()
    path = tmp_path / "absent" / "trace.mcap"
    with pytest.raises(OutputError, match=r"absent/trace\.mcap: No such file or directory"):
        write_trace(path, trace, 0, series, extras)


def test_a_file_that_does_not_fit_leaves_the_former_one(
    tmp_path: Path, make_trace: MakeTrace, extras: TraceExtras
) -> None:
    path = tmp_path / "trace.mcap"
    path.write_bytes(b"former")
    trace, series = make_trace(steps=200)
    with (
        largest_file(4096),
        pytest.raises(OutputError, match=r"trace\.mcap: File too large"),
    ):
        write_trace(path, trace, 0, series, extras)
    assert path.read_bytes() == b"former"
    assert list(tmp_path.iterdir()) == [path]


@contextmanager
def largest_file(size: int) -> Generator[None]:
    """Let the system refuse longer files, as it does on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match=r"cannot read .*absent\.mcap: No such file"):
        read_trace(tmp_path / "absent.mcap")


def test_a_foreign_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "foreign.mcap"
    writer = Writer(str(path), enable_data_crcs=True)
    writer.start()
    schema = writer.register_schema("Thing", "jsonschema", b'{"type": "object"}')
    channel = writer.register_channel("/state", "json", schema)
    writer.add_message(channel, 0, b"{}", 0)
    writer.finish()
    with pytest.raises(StoreError, match="its schema of State differs"):
        read_trace(path)


@pytest.mark.long
@settings(max_examples=200, deadline=None)
@given(data=st.data(), form=st.sampled_from(["messages", "compact"]))
def test_every_flipped_byte_and_every_cut_is_noticed(
    tmp_path_factory: pytest.TempPathFactory,
    make_trace: MakeTrace,
    extras: TraceExtras,
    data: st.DataObject,
    form: TraceFormat,
) -> None:
    path = tmp_path_factory.getbasetemp() / "damaged.mcap"
    trace, series = make_trace(steps=3)
    write_trace(path, trace, 0, series, extras, form)
    file = path.read_bytes()
    place = data.draw(st.integers(0, len(file) - 1))
    flip = data.draw(st.integers(0, 255))
    flipped = file[:place] + bytes([file[place] ^ flip]) + file[place + 1 :]
    path.write_bytes(flipped if flip else file[:place])
    with pytest.raises(StoreError, match=r"damaged\.mcap"):
        read_trace(path)
