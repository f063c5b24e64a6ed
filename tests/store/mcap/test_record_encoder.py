"""What a run's file holds does not depend on how its arrays lie in memory."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.written_traces import TraceExtras

from contactlab.contact.trace_arrays import PairSeries, Trace
from contactlab.schema.vocabulary import TraceFormat
from contactlab.store.mcap import record_encoder
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
def test_records_filled_in_parts_are_those_filled_at_once(
    make_trace: MakeTrace, extras: TraceExtras, form: TraceFormat, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where a part ends within a pair, and of pairs that are given in another order."""
    trace, series = make_trace(runs=2, steps=40, pairs=("a-b", "c-d", "e-f"), momentum=True)
    whole = [TraceEncoder(trace, series).encode_run(run, *extras, form=form) for run in range(2)]
    monkeypatch.setattr(record_encoder, "_BLOCK_BYTES", 7 * contacts_record(1).size)
    parts = TraceEncoder(trace, series[::-1])
    assert [parts.encode_run(run, *extras, form=form) for run in range(2)] == whole


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
