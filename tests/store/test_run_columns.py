"""The table as arrays says the same as the table as rows."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactlab.errors import StoreError
from contactlab.store.finished_store import Store
from contactlab.store.row_journal import write_journal
from contactlab.store.run_columns import RunColumns
from contactlab.store.runs_table import write_table
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
    values, places = columns.ranked("depth", [-1.0, 0.5])
    assert values[places].tolist() == numbers.values.tolist()
    assert values.tolist() == sorted({-1.0, 0.5, *numbers.values.tolist()})
    values, places = columns.ranked("gain", [2.0])
    assert np.isnan(values).tolist() == [False, True]
    assert places.tolist() == [1, 1, 1]
    for name in ("label", "timestep", "status_reason"):
        codes, values = columns.coded(name)
        assert [values[code] for code in codes] == [row[name] for row in rows]
        assert len({*values}) == len(values)
    assert [columns.run_id(place) for place in range(3)] == [row["run_id"] for row in rows]
    assert [columns.place_of(row["run_id"]) for row in rows] == [0, 1, 2]
    assert columns.place_of("none") is None
    distinct = [tuple(row.values()) for row in columns.distinct(["label", "seed"])]
    assert {*distinct} == {(row["label"], row["seed"]) for row in rows}
    for first in ("trace_file", "status_reason", "seed"):
        given = [{name: row[name] for name in (first, "label")} for row in rows]
        present = [row for row in given if row[first] is not None]
        assert [*columns.present([first, "label"])] == present
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


def test_only_what_is_measured_says_which_way_is_better(store: Path) -> None:
    measured = Store.open(store).columns.measured
    assert {"depth", "gain", "cost_cpu_per_sim_s"} <= set(measured)
    assert not {"timestep", "seed", "label", "duration"} & set(measured)
    assert measured["cost_cpu_per_sim_s"].better == "lower"


def test_no_such_column(store: Path) -> None:
    with pytest.raises(StoreError, match=r"runs\.parquet has no column 'dept'"):
        Store.open(store).columns.numbers("dept")
