"""The table as arrays says the same as the table as rows."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from contactlab.errors import StoreError
from contactlab.store import run_columns, runs_table
from contactlab.store.finished_store import Store
from contactlab.store.row_journal import write_journal
from contactlab.store.run_columns import RunColumns
from contactlab.store.runs_table import GROUP, iterate_rows, rows_of_group, write_table
from contactlab.store.table_layout import record_to_row


def test_columns_are_the_rows(store: Path) -> None:
    opened = Store.open(store)
    rows, columns = opened.table.to_pylist(), opened.columns
    assert columns.runs == len(rows) == 3
    assert columns.axis_names == ("timestep",)
    numbers = columns.numbers("depth")
    assert numbers.values.tolist() == [row["depth"] for row in rows]
    assert numbers.valid.all()
    nothing = columns.numbers("gain")
    assert np.isnan(nothing.values).all()
    assert not nothing.valid.any()
    values, places = columns.rank_numbers("depth", [-1.0, 0.5])
    assert values[places].tolist() == numbers.values.tolist()
    assert values.tolist() == sorted({-1.0, 0.5, *numbers.values.tolist()})
    values, places = columns.rank_numbers("gain", [2.0])
    assert np.isnan(values).tolist() == [False, True]
    assert places.tolist() == [1, 1, 1]
    for name in ("label", "timestep", "status_reason"):
        codes, values = columns.read_codes(name)
        assert [values[code] for code in codes] == [row[name] for row in rows]
        assert len({*values}) == len(values)
    assert [columns.run_id(place) for place in range(3)] == [row["run_id"] for row in rows]
    assert [columns.place_of(row["run_id"]) for row in rows] == [0, 1, 2]
    assert columns.place_of("none") is None
    distinct = [tuple(row.values()) for row in columns.iterate_distinct(["label", "seed"])]
    assert {*distinct} == {(row["label"], row["seed"]) for row in rows}
    for first in ("trace_file", "status_reason", "seed"):
        given = [{name: row[name] for name in (first, "label")} for row in rows]
        present = [row for row in given if row[first] is not None]
        assert [*columns.iterate_present([first, "label"])] == present
    assert columns.byte_strings("run_id").tolist() == [row["run_id"].encode() for row in rows]
    assert columns.identify([2, 0]) == [
        {name: rows[place][name] for name in ("run_id", "seed", "timestep")} for place in (2, 0)
    ]
    assert columns.to_pydict(["label", "index"]) == {
        name: [row[name] for row in rows] for name in ("label", "index")
    }


def test_truth_values_are_numbers(store: Path) -> None:
    columns = Store.open(store).columns
    assert columns.is_number("expectation_met")
    assert not columns.numbers("expectation_met").valid.any()
    assert not columns.is_number("label")


def test_word_sets_are_masks(
    tmp_path: Path, record_of: Callable[..., Any], columns_of: Any, shared_part: Any
) -> None:
    labels = [["tunneling", "chatter"], [], ["chatter"]]
    records = [record_of(index) for index in range(3)]
    rows = [
        record_to_row(each) | {"labels": found} for each, found in zip(records, labels, strict=True)
    ]
    journal = tmp_path / "rows"
    write_journal(journal, rows)
    write_table(journal, tmp_path / "runs.parquet", columns_of(records), shared_part(records[0]))
    masks, words = RunColumns(tmp_path).string_sets("labels")
    found = [[word for bit, word in enumerate(words) if mask >> bit & 1] for mask in masks]
    assert [sorted(each) for each in found] == [sorted(each) for each in labels]


def test_rows_are_found_in_parts_of_row_groups(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A group of seven rows is read in parts of three, of which the last is one row."""
    table = pa.table({"run_id": [f"{row:016x}" for row in range(17)], "seed": range(17)})
    pq.write_table(table, tmp_path / "runs.parquet", row_group_size=7)
    for module in (runs_table, run_columns):
        monkeypatch.setattr(module, "GROUP", 3)
    monkeypatch.setattr(run_columns, "check_layout", lambda *_: None)
    monkeypatch.setattr(run_columns, "shared_fields", lambda _: {})
    columns = RunColumns(tmp_path)
    for rows in ([16, 0, 6, 7, 13, 3], [*range(17)]):
        assert columns.select_values(["seed"], rows) == [{"seed": row} for row in rows]
    for start, stop in combinations(range(18), 2):
        found = columns.read_between("seed", slice(start, stop))
        assert found.to_pylist() == [*range(start, stop)]
    assert columns.numbers("seed").values.tolist() == [*range(17)]
    assert columns.has_value("seed").all()
    chosen = np.isin(np.arange(17), [2, 15])
    rows = iterate_rows(tmp_path / "runs.parquet", chosen)
    assert [row["seed"] for row in rows] == [2, 15]


def test_threads_that_read_at_once_get_their_own_columns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One reader shared by two threads ends in an error within a few of these reads."""
    rows, names = 20_000, [f"c{number}" for number in range(8)]
    table = pa.table({name: np.arange(rows) * 10 + place for place, name in enumerate(names)})
    pq.write_table(table, tmp_path / "runs.parquet", row_group_size=500)
    monkeypatch.setattr(run_columns, "check_layout", lambda *_: None)
    monkeypatch.setattr(run_columns, "shared_fields", lambda _: {})
    columns = RunColumns(tmp_path)
    with ThreadPoolExecutor(4) as pool:
        read = [*pool.map(lambda name: columns.numbers(name).values, names * 8)]
    for place, values in enumerate(read):
        assert np.array_equal(values, np.arange(rows) * 10 + place % len(names))


def test_large_tables_have_no_more_row_groups_than_small_ones() -> None:
    """Whoever opens a table unpacks what it says of each: a group is 16,384 rows times 2^k."""
    assert [rows_of_group(runs) for runs in (0, 1, 256 * GROUP)] == [GROUP] * 3
    for runs in (256 * GROUP + 1, 10**7, 10**9):
        size = rows_of_group(runs)
        assert runs <= 256 * size
        assert runs > 128 * size
        assert np.log2(size / GROUP) % 1 == 0


def test_only_what_is_measured_says_which_way_is_better(store: Path) -> None:
    measured = Store.open(store).columns.metric_columns
    assert {"depth", "gain", "cost_cpu_per_sim_s"} <= set(measured)
    assert not {"timestep", "seed", "label", "duration"} & set(measured)
    assert measured["cost_cpu_per_sim_s"].better == "lower"


def test_no_such_column(store: Path) -> None:
    with pytest.raises(StoreError, match=r"runs\.parquet has no column 'dept'"):
        Store.open(store).columns.numbers("dept")
