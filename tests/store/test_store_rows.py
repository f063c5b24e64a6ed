"""A record survives the journal and the table; the table explains itself to other readers."""

import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import duckdb
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contactlab.errors import StoreError
from contactlab.schema.coverage import Coverage, PairUse, Travel
from contactlab.schema.evidence import Accuracy, Cost, EvidenceRecord, LabelEntry, Timing, TraceFile
from contactlab.store.finished_store import Store, similar_ids
from contactlab.store.row_journal import write_journal
from contactlab.store.runs_table import iterate_rows, shared_fields, write_table
from contactlab.store.table_layout import record_to_row, row_to_record

MANY_IDS = pa.array([hashlib.sha256(b"%d" % run).hexdigest()[:16] for run in range(10_000)])

RecordOf = Callable[..., EvidenceRecord]

REALS = st.floats(allow_nan=False, allow_infinity=False)
WHOLES = st.integers(-(2**63), 2**63 - 1)
# Whole numbers that a column of reals can hold.
EXACT = st.integers(-(2**53), 2**53)
COUNTS = st.integers(0, 2**63 - 1)
HASHES = st.text("0123456789abcdef", min_size=1, max_size=64)
WORDS = st.text(st.characters(exclude_categories=["Cs"]), max_size=8)
LABELS = st.builds(LabelEntry, label=WORDS, reason=WORDS, step=st.none() | COUNTS)
COSTS = st.builds(
    Cost,
    cpu_s=REALS,
    cpu_per_sim_s=REALS,
    latency_budget_s=st.none() | REALS,
    latency_used=st.none() | REALS,
)
ACCURACIES = st.builds(
    Accuracy,
    **dict.fromkeys(
        ("error_final", "error_mean", "error_peak"),
        st.none() | REALS,
    ),
    **dict.fromkeys(
        ("error_estimate", "error_final_estimate", "error_mean_estimate"),
        st.none() | REALS,
    ),
    error_kind=st.sampled_from(["trajectory", "local", "invariants"]),
    chaotic=st.none() | st.booleans(),
    reference_integrator=st.none() | WORDS,
    reference_timestep=st.none() | REALS,
    impacts=st.none() | COUNTS,
    solref_rule=st.sampled_from([None, "absolute", "tied"]),
    solref_clamped=st.booleans(),
)
TIMINGS = st.builds(
    Timing,
    **dict.fromkeys(set(Timing.model_fields) - {"timing_settings"}, st.none() | REALS),
    timing_settings=WORDS,
)
TRACES = st.builds(
    TraceFile,
    file=HASHES.map(lambda run: f"traces/00/{run}.mcap"),
    sha256=HASHES.map(lambda some: some.zfill(64)),
    bytes=COUNTS,
    messages=st.dictionaries(WORDS, COUNTS, max_size=3),
)
SHARES = st.floats(0, 1)
TRAVELS = st.builds(
    Travel,
    moved=SHARES,
    share=st.none() | SHARES,
    ends=st.sampled_from([(), ("lower",), ("lower", "upper")]),
    turned=st.none() | SHARES,
)
COVERAGES = st.builds(
    Coverage,
    joints=st.dictionaries(WORDS, TRAVELS, max_size=2),
    equalities=st.dictionaries(WORDS, SHARES, max_size=2),
    pairs=st.dictionaries(WORDS, st.builds(PairUse, touched=SHARES, slid=SHARES), max_size=2),
)
CHANGES = st.fixed_dictionaries(
    {
        # An axis keeps its kind throughout a sweep, numbers apart, and so does a setting.
        "axes": st.fixed_dictionaries(
            {"real": REALS, "number": EXACT | REALS, "word": WORDS, "switch": st.booleans()},
            optional={"extra": WHOLES},
        ),
        "settings": st.fixed_dictionaries(
            {"pair": st.tuples(REALS, REALS), "cone": WORDS, "mass": REALS, "iterations": WHOLES},
            optional={"dof_damping[hinge]": REALS},
        ),
        "effects": st.fixed_dictionaries({"refsafe": st.booleans(), "sleep": st.booleans()}),
        "metrics": st.fixed_dictionaries({"depth": st.none() | REALS, "gain": st.none() | REALS}),
        "labels": st.lists(LABELS, max_size=3).map(tuple),
        "label": WORDS,
        "edited_geoms": st.lists(WORDS, max_size=3).map(tuple),
        "warnings": st.dictionaries(WORDS, COUNTS, max_size=2),
        "expected": st.none() | st.lists(WORDS, max_size=2).map(tuple),
        "expectation_met": st.none() | st.booleans(),
        "expectation_reason": st.none() | WORDS,
        "tolerances_met": st.none() | st.booleans(),
        "status_reason": st.none() | WORDS,
        "trajectory_hash": st.none() | HASHES,
        "seed": COUNTS,
        "duration": REALS,
        "cost": st.none() | COSTS,
        "accuracy": st.none() | ACCURACIES,
        "timing": st.none() | TIMINGS,
        "trace": st.none() | TRACES,
        "coverage": st.none() | COVERAGES,
        "started": st.none() | WORDS,
        "finished": st.none() | st.just("2026-01-01T00:00:00.000+00:00"),
    }
)


def write(
    folder: Path, records: Sequence[EvidenceRecord], columns: Any, shared: dict[str, Any]
) -> Path:
    """Write the table of records, by way of a journal in another order than theirs."""
    journal, table = folder / "journal.jsonl", folder / "runs.parquet"
    write_journal(journal, map(record_to_row, reversed(records)))
    write_table(journal, table, columns, shared)
    return table


def kinds(record: EvidenceRecord) -> dict[str, type]:
    """Return the type of every setting: 1 equals 1.0, but is another setting."""
    return {name: type(value) for name, value in record.settings.items()}


@pytest.mark.long
@given(changes=st.lists(CHANGES, min_size=1, max_size=4))
@settings(deadline=None, max_examples=50)
def test_records_survive_the_table(
    changes: list[dict[str, Any]],
    tmp_path_factory: pytest.TempPathFactory,
    record_of: RecordOf,
    columns_of: Callable[..., Any],
    shared_part: Callable[..., Any],
) -> None:
    records = [record_of(index, **change) for index, change in enumerate(changes)]
    folder = tmp_path_factory.mktemp("table")
    path = write(folder, records, columns_of(records), shared_part(records[0]))
    table = pq.read_table(path)
    read = [row_to_record(row, shared_fields(table.schema)) for row in table.to_pylist()]
    assert read == records
    assert [kinds(each) for each in read] == [kinds(each) for each in records]


@pytest.mark.long
@given(changes=st.lists(CHANGES, min_size=1, max_size=4))
@settings(deadline=None, max_examples=50)
def test_a_table_survives_the_journal(
    changes: list[dict[str, Any]],
    tmp_path_factory: pytest.TempPathFactory,
    record_of: RecordOf,
    columns_of: Callable[..., Any],
    shared_part: Callable[..., Any],
) -> None:
    """A finished store that is reopened and finished again has the same table."""
    records = [record_of(index, **change) for index, change in enumerate(changes)]
    folder = tmp_path_factory.mktemp("table")
    columns, shared = columns_of(records), shared_part(records[0])
    path = write(folder, records, columns, shared)
    journal, again = folder / "again.jsonl", folder / "again.parquet"
    write_journal(journal, iterate_rows(path))
    write_table(journal, again, columns, shared)
    assert pq.read_table(again).equals(pq.read_table(path), check_metadata=True)
    assert again.read_bytes() == path.read_bytes()


@given(change=CHANGES)
@settings(deadline=None)
def test_records_survive_the_journal(
    change: dict[str, Any], record_of: RecordOf, shared_part: Callable[..., Any]
) -> None:
    record = record_of(**change)
    row = json.loads(json.dumps(record_to_row(record), allow_nan=False))
    assert row_to_record(row, shared_part(record)) == record


def test_a_record_is_found_by_its_id_or_the_start_of_it(store: Path) -> None:
    opened = Store.open(store)
    records = list(opened.records())
    assert [record.index for record in records] == [0, 1, 2]
    assert [opened.record(record.run_id) for record in records] == records
    assert opened.trace(records[0]).qpos.shape == (5, 1)


@pytest.mark.parametrize(
    ("run", "message"),
    [
        ("00", r"3 runs in .* have ids that start with '00' \(0+0, 0+1, 0+2, ...\); write more"),
        ("000000000000000f", "no run in .* starts with '000000000000000f'; did you mean '0"),
    ],
)
def test_an_id_of_no_or_many_runs(store: Path, run: str, message: str) -> None:
    with pytest.raises(StoreError, match=message):
        Store.open(store).record(run)


@given(
    run=st.integers(0, 9999),
    place=st.integers(0, 15),
    letter=st.sampled_from("0123456789abcdefxyz"),
)
def test_a_mistyped_id_is_found_among_few(run: int, place: int, letter: str) -> None:
    """However many runs there are: the search for the closest one is slow."""
    meant = MANY_IDS[run].as_py()
    similar = similar_ids(meant[:place] + letter + meant[place + 1 :], MANY_IDS)
    assert meant in similar
    assert len(similar) <= 64


def test_similar_ids_of_no_id() -> None:
    assert similar_ids("zz", pa.array(["00", "01"])) == []
    assert similar_ids("", pa.array(["00", "01"])) == []
    assert len(similar_ids("0" * 15 + "f", pa.array(["0" * 15 + "1"] * 9999))) <= 64


def test_a_run_without_trace(store: Path, record_of: RecordOf) -> None:
    with pytest.raises(StoreError, match="no trace of run 0000000000000000 was kept"):
        Store.open(store).trace(record_of(0))


def test_every_column_is_described(store: Path) -> None:
    for field in pq.read_schema(store / "runs.parquet"):
        assert field.metadata[b"description"], field.name
        number = str(field.type) in {"int64", "double", "list<element: double>"}
        assert not number or b"unit" in field.metadata or "initial" in field.name, field.name


def test_units_stand_in_the_files_own_key_values(store: Path) -> None:
    """Readers that know nothing of Arrow see them as well."""
    file = pq.ParquetFile(store / "runs.parquet")
    described = json.loads(file.metadata.metadata[b"contactlab.columns"])
    assert list(described) == file.schema_arrow.names
    assert described["depth"] == {
        "unit": "m",
        "description": "what depth is",
        "better": "none",
        "resolution": "0",
    }
    assert described["cost_cpu_s"]["unit"] == "s"
    for field in file.schema_arrow:
        inner = {key.decode(): text.decode() for key, text in field.metadata.items()}
        assert {key: inner[key] for key in described[field.name]} == described[field.name]


def test_duckdb_reads_the_table(store: Path) -> None:
    table = str(store / "runs.parquet")
    rows = duckdb.execute(
        "select timestep, depth, gain, label, settings.solref[1], effects.refsafe"
        " from read_parquet(?) where not list_contains(labels, 'tunneling') order by timestep",
        [table],
    ).fetchall()
    assert rows == [
        (1e-3, 1e-3, None, "stable", 0.02, True),
        (2e-3, 1e-3, None, "stable", 0.02, True),
        (3e-3, 1e-3, None, "stable", 0.02, True),
    ]
    (units,) = duckdb.execute(
        "select decode(value) from parquet_kv_metadata(?) where decode(key) = 'contactlab.columns'",
        [table],
    ).fetchall()
    assert json.loads(units[0])["timestep"]["unit"] == "s"
