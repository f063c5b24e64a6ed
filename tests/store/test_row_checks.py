"""What whole columns say of rows, against each record built and checked by itself."""

import math
from collections.abc import Callable, Iterator
from typing import Any

import pyarrow as pa
import pytest

from contactlab.schema.coverage import Coverage
from contactlab.schema.evidence import (
    RECORD_VERSION,
    Accuracy,
    Cost,
    EvidenceRecord,
    LabelEntry,
    SweepIdentity,
    Timing,
    TraceFile,
)
from contactlab.store.row_checks import RowChecks
from contactlab.store.table_layout import record_to_row, row_to_record, table_schema
from contactlab.store.verify_store import wrong_parts

BUDGET = 2e-3
SHARED = {
    "schema_version": RECORD_VERSION,
    "sweep": "tried",
    "metric_versions": {"depth": 1, "gain": 1},
    "units": {"depth": "m", "gain": "1"},
}
LABELS = (
    LabelEntry(label="chatter", reason="as planted", step=1, bodies=("ball", "box")),
    LabelEntry(label="creep", reason="it creeps", step=None),
)
TEXTS = (None, "", "x", "ok", "1", "null", "[]", "{}", '{"x": 1}', "[null]")
NUMBERS = (None, math.nan, math.inf, -1.0, 0.0, 1e300)
OTHERS = {
    pa.string(): TEXTS,
    pa.int64(): (None, -1, 0, 2**60),
    pa.float64(): NUMBERS,
    pa.bool_(): (None, True, False),
    pa.list_(pa.string()): (None, [], ["x"], [None], ["x", "y"], ["x", None]),
    pa.list_(pa.int64()): (None, [], [3], [None], [1, None], [None, 1]),
    pa.list_(pa.float64()): (None, [], [0.5], [None], [math.nan], [0.0, math.inf]),
    pa.list_(pa.list_(pa.string())): (None, [], [[]], [[], ["x"]], [None, []], [[None], []]),
}
KINDS = (pa.string(), pa.int64(), pa.float64(), pa.bool_(), pa.list_(pa.string()))


@pytest.fixture(scope="module")
def sweep(identity_of: Callable[..., SweepIdentity]) -> SweepIdentity:
    asked = {"latency_budget": BUDGET, "accuracy": {"against": "own"}, "timing": {"rounds": 3}}
    return identity_of(3, resolved={**asked, "knife_edge": True})


@pytest.fixture(scope="module")
def sound(record_of: Callable[..., EvidenceRecord], columns_of: Any) -> pa.RecordBatch:
    """Three rows; the second has all that a record may have, the others what it must."""
    part = Coverage.model_validate({"joints": {"ball": {"moved": 0.5}}})
    trace = {"sha256": "a" * 64, "bytes": 9, "messages": {"/state": 5}}
    full = record_of(
        1,
        status="stopped",
        status_reason="the engine stopped",
        label="chatter",
        labels=LABELS,
        expected=("stable", "creep"),
        expectation_met=False,
        expectation_reason="expected stable",
        tolerances_met=True,
        knife_edge=False,
        coverage=part,
        effects_missed={"limit": "it passes"},
        warnings={"BADQACC": 2},
        controls="c" * 64,
        cost=Cost.of_steps(1.5, 4, 2e-3, BUDGET),
        accuracy=Accuracy(
            **dict.fromkeys(("error_final", "error_mean", "error_peak", "error_estimate"), 1e-3),
            **dict.fromkeys(("error_final_estimate", "error_mean_estimate"), 1e-4),
            error_kind="local",
            chaotic=None,
            reference_integrator="RK4",
            reference_timestep=1e-5,
            impacts=1,
            solref_rule="tied",
            solref_clamped=False,
        ),
        timing=Timing(
            **{name: 1.0 for name in Timing.model_fields if name != "timing_settings"},
            timing_settings="t",
        ),
        trace=TraceFile.model_validate({"file": f"traces/01/{1:016x}.mcap", **trace}),
    )
    crashed = record_of(
        2, status="crashed", status_reason="it died", cost=None, trajectory_hash=None, steps=0
    )
    reason = LabelEntry(label="crashed", reason="it died", step=None)
    nothing = {"label": "crashed", "labels": (reason,), "metrics": dict.fromkeys(crashed.metrics)}
    crashed = crashed.model_copy(update=nothing)
    records = [record_of(0, cost=Cost.of_steps(1.0, 4, 1e-3, BUDGET)), full, crashed]
    schema = table_schema(columns_of(records))
    rows = [record_to_row(record) for record in records]
    return pa.RecordBatch.from_pylist(rows, schema)


def broken(rows: pa.RecordBatch, sweep: SweepIdentity) -> list[bool]:
    """Return which rows break a law, by their records."""
    found: list[bool] = []
    for row in rows.to_pylist():
        try:
            record = row_to_record(row, SHARED)
            found.append(any(wrong_parts(row, record, sweep)))
        except (LookupError, TypeError, ValueError):
            found.append(True)
    return found


def planted(column: pa.Array, place: int) -> Iterator[pa.Array]:
    """Yield a column with other values at a place, and at the first as columns of other types."""
    values = column.to_pylist()
    kind = column.type
    if pa.types.is_struct(kind):
        yield pa.array([*values[:place], None, *values[place + 1 :]], kind)
        for inner, entry in zip(kind, column.flatten(), strict=True):
            for other in planted(entry, place):
                entries = dict(zip(kind.names, column.flatten(), strict=True)) | {inner.name: other}
                yield pa.StructArray.from_arrays([*entries.values()], [*entries])
        return
    for value in OTHERS[kind]:
        yield pa.array([*values[:place], value, *values[place + 1 :]], kind)
    for other in KINDS if place == 0 else ():
        if other != kind:
            yield pa.array([OTHERS[other][-1]] * len(values), other)


def test_sound_rows_are_not_suspected(sound: pa.RecordBatch, sweep: SweepIdentity) -> None:
    assert broken(sound, sweep) == [False] * 3
    assert RowChecks(sweep, SHARED).find_suspects(sound).tolist() == [False] * 3


def test_a_knife_edge_that_was_not_looked_for_breaks_a_law(
    sound: pa.RecordBatch, sweep: SweepIdentity
) -> None:
    other = sweep.model_copy(update={"resolved": {**sweep.resolved, "knife_edge": False}})
    assert broken(sound, other) == [False, True, False]
    assert RowChecks(other, SHARED).find_suspects(sound).tolist() == [False, True, False]


@pytest.mark.long
@pytest.mark.parametrize("place", [0, 1, 2])
def test_each_row_that_breaks_a_law_is_suspected(
    sound: pa.RecordBatch, sweep: SweepIdentity, place: int
) -> None:
    """Every value of every column in turn; and of these most that are sound are not suspected."""
    checks, tried, faults, spared = RowChecks(sweep, SHARED), 0, 0, 0
    for number, name in enumerate(sound.schema.names):
        for column in planted(sound.columns[number], place):
            rows = sound.set_column(number, name, column)
            laws, found = broken(rows, sweep), checks.find_suspects(rows).tolist()
            missed = [row for row in range(3) if laws[row] and not found[row]]
            assert not missed, f"{name} = {column.to_pylist()}: rows {missed}"
            tried, faults, spared = tried + 1, faults + any(laws), spared + (not any(found))
    assert faults > 300
    assert spared > 0.5 * (tried - faults)


def test_a_column_that_is_missing(sound: pa.RecordBatch, sweep: SweepIdentity) -> None:
    checks = RowChecks(sweep, SHARED)
    for number, name in enumerate(sound.schema.names):
        fewer = pa.RecordBatch.from_arrays(
            [column for place, column in enumerate(sound.columns) if place != number],
            names=[other for other in sound.schema.names if other != name],
        )
        laws, found = broken(fewer, sweep), checks.find_suspects(fewer).tolist()
        assert all(found[row] for row in range(3) if laws[row]), name


@pytest.mark.parametrize("name", ["accuracy", "timing", "latency_budget"])
def test_what_the_sweep_did_not_ask_for(
    sound: pa.RecordBatch, sweep: SweepIdentity, name: str
) -> None:
    other = sweep.model_copy(update={"resolved": {**sweep.resolved, name: None}})
    laws = broken(sound, other)
    assert laws == [name == "latency_budget", True, False]
    assert RowChecks(other, SHARED).find_suspects(sound).tolist() == laws
