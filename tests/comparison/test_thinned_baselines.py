"""A baseline cannot turn the gate off: what it leaves out is counted, and too much is refused."""

from collections.abc import Callable
from itertools import combinations
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from contactlab.comparison.compare_stores import compare_stores
from contactlab.errors import StoreError
from contactlab.schema.comparison import ComparePolicy, ComparisonReport
from contactlab.schema.finding import Finding

Runs = Callable[[], Any]
Stored = Callable[..., Path]
LOOKED_FOR = {"version": 1, "scene": "ball", "thresholds": {}, "knife_edge": True}
ENOUGH = "enough is judged"
NOT_COMPARABLE = 3


def check(report: ComparisonReport, name: str) -> Finding:
    (found,) = [each for each in report.findings if each.name == name]
    return found


def fill(store: Path, tampering: Any, column: str, value: object) -> None:
    """Set a column of the table to one value, and redo the hashes, as who attacks would."""
    table = pq.read_table(store / "runs.parquet")
    place = table.schema.get_field_index(column)
    field = table.schema.field(place)
    filled = pa.array([value] * len(table), field.type)
    tampering.rewrite(store, table.set_column(place, field, filled))


@pytest.fixture
def worse(runs: Runs, stored: Stored) -> Path:
    """A candidate that is twenty times deeper, and tunnels, in every run."""
    given = runs()
    for index in range(8):
        given.measure(index, depth=2e-2)
        given.label(index, "tunneling")
    return stored("worse", given)


@pytest.mark.usefixtures("worse")
def test_every_row_on_a_knife_edge(baseline: Path, worse: Path, tampering: Any) -> None:
    """The attack as it was found: one column of the committed table."""
    assert compare_stores(baseline, worse).exit_code == 1
    fill(baseline, tampering, "knife_edge", True)
    with pytest.raises(StoreError, match="its knife_edge contradicts its other values"):
        compare_stores(baseline, worse)


def test_flags_of_a_sweep_that_looks_for_none_are_not_honored(
    baseline: Path, worse: Path, tampering: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor in a store that is so large that not every record is looked at."""
    monkeypatch.setattr("contactlab.store.verify_store._MAX_QUICK_RECORDS", 0)
    for store in (baseline, worse):
        fill(store, tampering, "knife_edge", True)
    report = compare_stores(baseline, worse)
    assert (report.exit_code, report.pairs.knife_edge) == (1, 0)


@pytest.mark.parametrize(("flagged", "code"), [(2, 1), (3, NOT_COMPARABLE), (8, NOT_COMPARABLE)])
@pytest.mark.parametrize("side", ["before", "after"])
def test_too_many_pairs_set_apart(
    runs: Runs, stored: Stored, flagged: int, code: int, side: str
) -> None:
    """Six of eight may be judged; then the last one, which is worse, is seen."""
    given = {"before": runs(), "after": runs()}
    for each in given.values():
        each.identity["resolved"] = LOOKED_FOR
    for index in range(flagged):
        given[side].change(index, knife_edge=True)
    if flagged == 2:
        given["after"].measure(7, depth=1.0)
    before, after = (stored(name, each) for name, each in given.items())
    report = compare_stores(before, after)
    assert report.exit_code == code
    assert f"{flagged} of 8 pairs set apart as knife-edge runs" in check(report, ENOUGH).message


@pytest.mark.parametrize(
    ("column", "value"),
    [("label", None), ("labels", None), ("labels", ["tunneling"]), ("status", "broken")],
)
def test_rows_that_contradict_themselves(
    baseline: Path, worse: Path, tampering: Any, column: str, value: object
) -> None:
    """A stable run whose list of labels has all of them would gain none."""
    fill(baseline, tampering, column, value)
    with pytest.raises(StoreError, match=r"baseline .* is not sound"):
        compare_stores(baseline, worse)


def test_a_metric_without_values(baseline: Path, runs: Runs, stored: Stored) -> None:
    blank = runs()
    for index in range(3):
        blank.measure(index, depth=None)
    deep = runs()
    for index in range(3):
        deep.measure(index, depth=1.0)
    stores = stored("blank", blank), stored("deep", deep)
    assert compare_stores(baseline, stores[1]).exit_code == 1
    report = compare_stores(*stores)
    found = check(report, "depth no worse")
    assert (report.exit_code, found.outcome) == (NOT_COMPARABLE, "skipped")
    assert found.message.startswith("3 of 8 runs without a value in the baseline")
    # One of eight is counted, and the others are judged.
    blank.measure(1, depth=1e-3)
    blank.measure(2, depth=1e-3)
    report = compare_stores(stored("one", blank), stores[1])
    assert report.exit_code == 1
    assert "1 changed" in check(report, "depth no worse").message


def test_a_metric_that_its_table_lost(baseline: Path, worse: Path, tampering: Any) -> None:
    table = pq.read_table(baseline / "runs.parquet")
    tampering.rewrite(baseline, table.drop_columns(["depth"]))
    with pytest.raises(StoreError, match=r"baseline .* is not sound"):
        compare_stores(baseline, worse)


def test_metrics_that_the_baseline_never_had(
    baseline: Path, worse: Path, tampering: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As of an older release, and so only counted; but not if most are missing."""
    monkeypatch.setattr("contactlab.store.verify_store._MAX_QUICK_RECORDS", 0)
    table = pq.read_table(baseline / "runs.parquet")
    tampering.rewrite(baseline, tampering.without_metrics(table, "depth", "grip", "slip"))
    for name in ("depth", "grip", "slip"):
        tampering.substitute(baseline / "sweep.json", f'"{name}": 1,', "")
    tampering.rehash(baseline)
    assert "3 of " in check(compare_stores(baseline, worse), ENOUGH).message
    strict = ComparePolicy.model_validate({"version": 1, "least_judged": 1.0})
    assert check(compare_stores(baseline, worse, strict), ENOUGH).outcome == "skipped"


@pytest.mark.parametrize(("kept", "outcome"), [(6, "noted"), (5, "skipped"), (1, "skipped")])
def test_runs_that_the_baseline_lacks(runs: Runs, stored: Stored, kept: int, outcome: str) -> None:
    fewer, bad = runs(), runs()
    del fewer.runs[kept:]
    for index in range(kept, 8):
        bad.label(index, "tunneling")
    report = compare_stores(stored("fewer", fewer), stored("bad", bad))
    found = check(report, ENOUGH)
    expected = (NOT_COMPARABLE, "skipped") if outcome == "skipped" else (0, "passed")
    assert (report.exit_code, found.outcome) == expected
    assert f"{8 - kept} of 8 runs of the candidate not in the baseline" in found.message


@pytest.mark.parametrize(
    ("column", "name"), [("expectation_met", "expectations"), ("tolerances_met", "tolerances")]
)
def test_expectations_that_the_baseline_is_silent_of(
    runs: Runs, stored: Stored, column: str, name: str
) -> None:
    silent, unmet = runs(), runs()
    for index in range(8):
        unmet.change(index, **{column: False})
    report = compare_stores(stored("silent", silent), stored("unmet", unmet))
    found = check(report, f"{name} still met")
    assert (report.exit_code, found.outcome) == (NOT_COMPARABLE, "skipped")


def test_duplicated_runs_are_refused(baseline: Path, worse: Path, tampering: Any) -> None:
    table = pq.read_table(baseline / "runs.parquet")
    for one, other in combinations(range(2), 2):
        rows = [*range(8)]
        rows[other] = one
        tampering.rewrite(baseline, table.take(rows))
        with pytest.raises(StoreError, match=r"baseline .* is not sound"):
            compare_stores(baseline, worse)


def test_nothing_is_said_of_an_honest_baseline(baseline: Path, runs: Runs, stored: Stored) -> None:
    report = compare_stores(baseline, stored("again", runs()))
    assert report.exit_code == 0
    assert check(report, ENOUGH).message == "all of the candidate"


@pytest.mark.parametrize(("depth", "code"), [(0.0, 3), (1e9, 3), (1.005e-3, 0)])
def test_metrics_that_contradict_equal_trajectories(
    baseline: Path, runs: Runs, stored: Stored, depth: float, code: int
) -> None:
    """Neither a better nor a worse value is a result; the tolerance of 1 % covers rounding."""
    bent = runs()
    trajectory = bent.runs[0].trajectory_hash
    bent.measure(0, depth=depth)
    bent.change(0, trajectory_hash=trajectory)
    report = compare_stores(baseline, stored("bent", bent))
    found = check(report, "depth no worse")
    assert (report.exit_code, found.outcome == "skipped") == (code, code == NOT_COMPARABLE)
    if code:
        assert found.message.startswith("1 of 8 runs with bitwise equal trajectories have other")
    # Another trajectory has other values, and so has another definition.
    bent.change(0, trajectory_hash="f" * 32)
    moved = compare_stores(baseline, stored("moved", bent))
    assert moved.exit_code == (1 if depth > 1 else 0)
    bent.change(0, trajectory_hash=trajectory)
    bent.versions = bent.versions | {"depth": 2}
    defined = check(compare_stores(baseline, stored("defined", bent)), "depth no worse")
    assert "equal trajectories" not in defined.message
