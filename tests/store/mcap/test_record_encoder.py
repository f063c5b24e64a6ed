"""Functions in C write the bytes that NumPy writes."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.compilers import has_compiler
from tests.random_traces import trace_sizes
from tests.sanitizers import run_sanitized
from tests.written_traces import TraceExtras

from contactlab import native
from contactlab.contact.trace_arrays import PairSeries, Trace
from contactlab.schema.vocabulary import TraceFormat
from contactlab.store.mcap import compact_blocks, file_parts
from contactlab.store.mcap.record_encoder import (
    Bytes,
    Integers,
    NativeEncoder,
    Records,
    record_encoder,
)
from contactlab.store.mcap.trace_messages import MessageLayout
from contactlab.store.mcap.trace_writer import TraceEncoder

MakeTrace = Callable[..., tuple[Trace, list[PairSeries]]]

pytestmark = pytest.mark.skipif(not has_compiler(), reason="there is no C compiler that works")
SWITCH = "CONTACTLAB_KERNEL"


def test_there_are_functions_in_c(monkeypatch: pytest.MonkeyPatch) -> None:
    """Or the other tests would compare NumPy with itself."""
    monkeypatch.setenv(SWITCH, "on")
    assert isinstance(record_encoder(), NativeEncoder)
    monkeypatch.setenv(SWITCH, "off")
    assert not isinstance(record_encoder(), NativeEncoder)


@settings(max_examples=150, deadline=None)
@given(
    sizes=trace_sizes(steps=150, runs=3),
    size=st.sampled_from([1, 700, file_parts.CHUNK_SIZE]),
    form=st.sampled_from(["messages", "compact"]),
)
def test_both_write_the_same_files(
    make_trace: MakeTrace,
    extras: TraceExtras,
    sizes: dict[str, Any],
    size: int,
    form: TraceFormat,
) -> None:
    trace, series = make_trace(**sizes)
    written: list[list[bytes]] = []
    for way in ("on", "off"):
        encoder = TraceEncoder(trace, series)
        with (
            patch.dict("os.environ", {SWITCH: way}),
            patch.object(file_parts, "CHUNK_SIZE", size),
            patch.object(compact_blocks, "BLOCK_SIZE", size),
        ):
            files = [encoder.encode(run, *extras, form=form)[0] for run in range(sizes["runs"])]
        written.append(files)
    assert written[0] == written[1]


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
        assert copied.encode(run, *extras, form=form) == viewed.encode(run, *extras, form=form)


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


def test_blocks_are_the_same_for_every_width_and_count() -> None:
    rng = np.random.default_rng(0)
    template = bytes(41)
    columns = (("a", "u1", 3), ("b", "<u2", 5), ("c", ("<u4", (3,)), 8), ("d", "<f8", 30))
    layout = MessageLayout(template, columns)
    for count in (1, 2, 3, 15, 16, 17, 63, 64, 65, 66, 129):
        records = rng.integers(0, 256, count * layout.size, np.uint8)
        found = [np.zeros(count * layout.packed, np.uint8) for _ in range(2)]
        for way, out in zip(("on", "off"), found, strict=True):
            with patch.dict("os.environ", {SWITCH: way}):
                record_encoder().pack(records, layout, out)
        assert found[0].tobytes() == found[1].tobytes()


def test_a_first_file_that_differs_is_written_by_numpy(
    make_trace: MakeTrace, extras: TraceExtras, monkeypatch: pytest.MonkeyPatch
) -> None:
    encoder = TraceEncoder(*make_trace(runs=1))
    monkeypatch.setenv(SWITCH, "off")
    expected = encoder.encode(0, *extras)
    monkeypatch.setenv(SWITCH, "on")
    monkeypatch.setattr(native, "_agreed", set())
    monkeypatch.setattr(native, "_given_up", set())
    true = NativeEncoder.write

    def write(self: NativeEncoder, records: Records, data: Bytes, starts: Integers) -> None:
        true(self, records, data, starts)
        data[len(data) // 2] ^= 1

    monkeypatch.setattr(NativeEncoder, "write", write)
    with pytest.warns(UserWarning, match="disagrees with NumPy") as said:
        assert encoder.encode(0, *extras) == expected
    assert encoder.encode(0, *extras) == expected
    assert len(said) == 1


@pytest.mark.slow
def test_sanitizers_find_nothing(tmp_path: Path) -> None:
    """The tests of this file again, in C that stops at whatever it leaves undefined."""
    run_sanitized(__file__, "not sanitizers", tmp_path)
