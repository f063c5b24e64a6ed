"""What a run's file holds does not depend on how its arrays lie in memory."""

import struct
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from tests.written_traces import TraceExtras

from contactlab.contact.trace_arrays import PairSeries, Trace
from contactlab.schema.vocabulary import TraceFormat
from contactlab.store.mcap import record_encoder
from contactlab.store.mcap.compact_blocks import expand_file
from contactlab.store.mcap.record_encoder import INDEX_HEAD, message_indexes
from contactlab.store.mcap.trace_messages import contacts_record
from contactlab.store.mcap.trace_writer import TraceEncoder

MakeTrace = Callable[..., tuple[Trace, list[PairSeries]]]


@pytest.mark.parametrize("form", ["messages", "compact"])
@pytest.mark.parametrize("rows", [slice(None, None, 2), slice(None, None, -1)])
def test_arrays_may_lie_anyhow(
    make_trace: MakeTrace, extras: TraceExtras, form: TraceFormat, rows: slice
) -> None:
    """Arrays whose runs are not one after the other give the bytes that copies of them do."""
    trace, series = make_trace(runs=5, steps=40, pairs=("a-b", "c-d"), momentum=True)
    chosen = [*range(5)[rows]]
    copied = TraceEncoder(trace.select(chosen), [_picked(each, chosen) for each in series])
    viewed = TraceEncoder(_viewed(trace, rows), [_picked(each, rows) for each in series])
    for run in range(len(chosen)):
        assert copied.encode_run(run, *extras, form=form) == viewed.encode_run(
            run, *extras, form=form
        )


@pytest.mark.parametrize("form", ["messages", "compact"])
@pytest.mark.parametrize("slots", [1, 4])
def test_records_of_c_are_those_of_numpy(
    make_trace: MakeTrace,
    extras: TraceExtras,
    form: TraceFormat,
    slots: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Also where a part ends within a pair, and of pairs that are given in another order."""
    sizes = {"slots": slots, "steps": 40, "runs": 2, "momentum": True}
    trace, series = make_trace(pairs=("a-b", "c-d", "e-f"), **sizes)
    encoder = TraceEncoder(trace, series)
    whole = [encoder.encode_run(run, *extras, form=form) for run in range(2)]
    monkeypatch.setenv("CONTACTLAB_KERNEL", "off")
    monkeypatch.setattr(record_encoder, "_BLOCK_BYTES", 7 * contacts_record(1).size)
    parts = TraceEncoder(trace, series[::-1])
    assert [parts.encode_run(run, *extras, form=form) for run in range(2)] == whole


def test_values_of_blocks_are_read_alike_by_c_and_by_numpy(
    make_trace: MakeTrace, extras: TraceExtras, monkeypatch: pytest.MonkeyPatch
) -> None:
    """More rows than C unpacks at once, and numbers of each width."""
    trace, series = make_trace(pairs=("a-b", "c-d"), slots=4, steps=600, runs=1, momentum=True)
    compact, _ = TraceEncoder(trace, series).encode_run(0, *extras, form="compact")
    expanded = expand_file(compact)
    monkeypatch.setenv("CONTACTLAB_KERNEL", "off")
    assert expand_file(compact) == expanded


def test_indexes_are_those_of_a_loop() -> None:
    """Chunks of one row, of some rows, and channels that are missing in a chunk."""
    rng = np.random.default_rng(0)
    sizes = rng.integers(1, 9, (40, 5)) * (rng.random((40, 5)) < 0.2)
    sizes[:, 0] = 7
    offsets = (np.cumsum(sizes) - sizes.ravel()).reshape(sizes.shape)
    times, cuts = np.arange(40, dtype=np.uint64) * 3, [0, 1, 9, 23, 40]
    found = message_indexes(times, sizes, offsets, cuts)
    for index, (first, last) in zip(found, pairwise(cuts), strict=True):
        expected, starts = b"", dict[int, int]()
        for channel in range(5):
            rows = [row for row in range(first, last) if sizes[row, channel]]
            entries = [(times[row], offsets[row, channel] - offsets[first, 0]) for row in rows]
            if rows:
                starts[channel + 1] = len(expected)
                expected += INDEX_HEAD.pack(7, 6 + 16 * len(rows), channel + 1, 16 * len(rows))
                expected += b"".join(struct.pack("<QQ", *map(int, entry)) for entry in entries)
        assert index == (expected, starts)


def _picked(series: PairSeries, rows: slice | list[int]) -> PairSeries:
    arrays = {name: each[rows] for name, each in vars(series).items() if name != "name"}
    return PairSeries(series.name, **arrays)


def _viewed(trace: Trace, rows: slice) -> Trace:
    """Return the chosen runs of a trace, all as views."""
    picked = trace.select([*range(trace.runs)[rows]])
    arrays: dict[str, Any] = {
        name: each[rows] for name, each in vars(trace).items() if isinstance(each, np.ndarray)
    }
    pairs = tuple(
        replace(each, slots=each.slots[rows], friction=each.friction[rows]) for each in trace.pairs
    )
    return replace(picked, pairs=pairs, **arrays)
