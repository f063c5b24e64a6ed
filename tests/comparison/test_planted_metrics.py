"""Planted changes of metrics: the right verdict, the right exit code, a line that says it."""

from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from contactlab.comparison.compare_stores import compare_stores
from contactlab.comparison.report import report_of
from contactlab.schema.comparison import ComparePolicy, ComparisonReport
from contactlab.schema.finding import Finding
from contactlab.writers import as_text

Runs = Callable[[], Any]
Stored = Callable[..., Path]


def policy(**changes: Any) -> ComparePolicy:
    return ComparePolicy.model_validate({"version": 1, **changes})


def check(report: ComparisonReport, name: str, group: str = "") -> Finding:
    (found,) = [each for each in report.findings if (each.name, each.group) == (name, group)]
    return found


@pytest.fixture
def large(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take stores for so large that not every record is looked at."""
    monkeypatch.setattr("contactlab.store.verify_store._MAX_QUICK_RECORDS", 0)


def test_one_worse_metric(baseline: Path, runs: Runs, stored: Stored) -> None:
    """The trajectory's hash being equal excuses nothing."""
    worse = runs()
    worse.measure(3, depth=1.5e-3)
    report = compare_stores(baseline, stored("worse", worse))
    assert (report.verdict, report.exit_code) == ("worse", 1)
    found = check(report, "depth no worse")
    assert (found.outcome, found.verdict, found.failing) == ("failed", "worse", 1)
    assert found.counts == {"same": 7, "worse": 1}
    assert found.message == "1 of 8 runs worse"
    (pair,) = found.worst
    assert (pair.baseline, pair.candidate) == (1e-3, 1.5e-3)
    assert pair.axes == {"cone": "elliptic", "timestep": 8e-3}
    line = "1 -> 1.5 mm (+50 %)  cone=elliptic timestep=0.008 [00000000]"
    assert line in as_text(report_of(report))


def test_the_headline_says_which_kind_of_check_changed(
    baseline: Path, runs: Runs, stored: Stored
) -> None:
    """A metric is counted once, however many groups it is judged in."""
    other = runs()
    for index in range(8):
        other.measure(index, grip=11.0, depth=1e-4 if index in {1, 6} else 1e-3)
    grouped = policy(metrics={"grip": {"by": ["cone"]}})
    report = compare_stores(baseline, stored("other", other), grouped)
    checks = len(report.findings)
    assert report.headline == f"better: no check of {checks} fails; 2 metrics better"
    relabeled = runs()
    relabeled.label(0, "chatter")
    before = runs()
    before.label(0, "diverged")
    report = compare_stores(stored("before", before), stored("relabeled", relabeled))
    assert report.headline.endswith("; 1 check of labels better, 1 check of labels changed")


def test_one_better_metric(baseline: Path, runs: Runs, stored: Stored) -> None:
    better = runs()
    better.measure(3, grip=11.0)
    report = compare_stores(baseline, stored("better", better))
    assert (report.verdict, report.exit_code) == ("better", 0)
    assert check(report, "grip no worse").outcome == "noted"
    assert "make the candidate the baseline: contactlab compare" in as_text(report_of(report))


def test_a_metric_without_a_better_side_may_not_change(
    baseline: Path, runs: Runs, stored: Stored
) -> None:
    other = runs()
    other.measure(0, slip=0.45)
    report = compare_stores(baseline, stored("other", other))
    assert (report.verdict, report.exit_code) == ("changed", 1)
    assert check(report, "slip unchanged").message == "1 of 8 runs changed"


def test_null_in_a_metric(baseline: Path, runs: Runs, stored: Stored) -> None:
    gone = runs()
    gone.measure(0, depth=None)
    report = compare_stores(baseline, stored("gone", gone))
    assert (report.verdict, report.exit_code) == ("missing", 1)
    assert report.headline.startswith("values missing: 1 of ")
    found = check(report, "depth no worse")
    assert (found.verdict, found.message) == ("missing", "1 of 8 runs without a value now")
    assert (found.worst[0].baseline, found.worst[0].candidate) == (1e-3, None)


def test_a_value_where_there_was_none(runs: Runs, stored: Stored) -> None:
    gone = runs()
    gone.measure(0, depth=None, slip=None)
    report = compare_stores(stored("gone", gone), stored("there", runs()))
    assert check(report, "depth no worse").outcome == "noted"
    assert check(report, "slip unchanged").outcome == "failed"


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
@pytest.mark.parametrize("sides", [["baseline"], ["candidate"], ["baseline", "candidate"]])
@pytest.mark.usefixtures("large")
def test_what_is_no_number_is_never_the_same(
    baseline: Path, runs: Runs, stored: Stored, tampering: Any, value: float, sides: list[str]
) -> None:
    stores = {"baseline": baseline, "candidate": stored("candidate", runs())}
    for side in sides:
        tampering.edit(stores[side], "depth", 0, value)
    report = compare_stores(stores["baseline"], stores["candidate"])
    assert (report.verdict, report.exit_code) == ("not comparable", 1)
    assert check(report, "depth no worse").message == "1 of 8 runs not a number"


@pytest.mark.usefixtures("large")
def test_a_metric_that_is_gone(baseline: Path, runs: Runs, stored: Stored, tampering: Any) -> None:
    candidate = stored("candidate", runs())
    table = pq.read_table(candidate / "runs.parquet")
    tampering.rewrite(candidate, tampering.without_metrics(table, "depth"))
    report = compare_stores(baseline, candidate)
    assert check(report, "depth no worse").message == "8 of 8 runs without a value now"
    assert report.exit_code == 1
    back = check(compare_stores(candidate, baseline), "depth no worse")
    assert (back.outcome, back.level) == ("skipped", "gate")


def test_a_doubled_solver_iteration_count(baseline: Path, runs: Runs, stored: Stored) -> None:
    slow = runs()
    for index in range(8):
        slow.measure(index, solver_iterations=200.0)
    report = compare_stores(baseline, stored("slow", slow))
    found = check(report, "solver_iterations no worse")
    assert (report.exit_code, found.outcome) == (1, "failed")
    assert found.message == "mean 100 -> 200 (+100 %), worse (tolerance 1 %)"


def test_a_slow_run_only_warns_and_only_on_the_same_machine(
    baseline: Path, runs: Runs, stored: Stored
) -> None:
    slow = runs()
    for index in range(8):
        slow.cost(index, 2.0)
    report = compare_stores(baseline, stored("slow", slow))
    found = check(report, "cost_cpu_per_sim_s no worse")
    assert (report.exit_code, found.kind, found.outcome) == (0, "time", "warned")
    assert found.message == "median ratio 2, worse (tolerance 15 %)"
    host = slow.provenance.host.model_copy(update={"cpu_model": "another"})
    slow.provenance = slow.provenance.model_copy(update={"host": host})
    report = compare_stores(baseline, stored("elsewhere", slow))
    found = check(report, "cost_cpu_per_sim_s no worse")
    assert (report.exit_code, found.outcome) == (0, "skipped")
    assert found.message == "cpu_model differs: cpu, now another"
    assert check(report, "same cpu_model").outcome == "warned"


def test_a_waived_check(baseline: Path, runs: Runs, stored: Stored) -> None:
    worse = runs()
    worse.measure(0, depth=2e-3)
    entry = {"check": "depth no worse", "max": 1, "reason": "softer", "until": "2026-06-30"}
    rules = policy(waive=[entry])
    candidate = stored("worse", worse)
    report = compare_stores(baseline, candidate, rules, today=date(2026, 6, 30))
    found = check(report, "depth no worse")
    assert (report.exit_code, found.outcome, found.waived) == (0, "noted", "softer")
    assert "1 of 8 runs worse; waived: softer" in as_text(report_of(report))
    assert compare_stores(baseline, candidate, rules, today=date(2026, 7, 1)).exit_code == 1
    worse.measure(1, depth=2e-3)
    more = compare_stores(baseline, stored("more", worse), rules, today=date(2026, 1, 1))
    assert "waived for 1, but 2 fail (softer)" in check(more, "depth no worse").message
    assert more.exit_code == 1


def test_budget(baseline: Path, runs: Runs, stored: Stored) -> None:
    """One run of eight is an eighth: within a budget of 0.125, not of less."""
    worse = runs()
    worse.measure(0, depth=2e-3)
    candidate = stored("worse", worse)
    within = compare_stores(baseline, candidate, policy(metrics={"depth": {"budget": 0.125}}))
    assert (within.verdict, within.exit_code) == ("changed", 0)
    assert check(within, "depth no worse").outcome == "warned"
    beyond = compare_stores(baseline, candidate, policy(metrics={"depth": {"budget": "12%"}}))
    assert beyond.exit_code == 1


def test_groups_are_judged_by_themselves(baseline: Path, runs: Runs, stored: Stored) -> None:
    """A quarter of one cone's runs is an eighth of all."""
    worse = runs()
    worse.measure(0, depth=2e-3)
    rule = {"by": ["cone"], "budget": 0.2}
    report = compare_stores(baseline, stored("worse", worse), policy(metrics={"depth": rule}))
    assert check(report, "depth no worse", "cone=elliptic").outcome == "failed"
    assert check(report, "depth no worse", "cone=pyramidal").outcome == "passed"


def test_a_second_pass_that_was_not_asked_for(runs: Runs, stored: Stored) -> None:
    """Only runs that are not stable are looked at again, so a healed run has no such metric."""
    before, after = runs(), runs()
    before.label(0, "chatter")
    before.measure(0, found=1e-9)
    report = compare_stores(stored("before", before), stored("after", after))
    assert check(report, "found no worse").message == "applies to no run"
    assert report.exit_code == 0
    before.measure(1, found=1e-9)
    report = compare_stores(stored("before2", before), stored("after2", after))
    assert check(report, "found no worse").message == "1 of 1 run without a value now"


def test_a_metric_defined_anew_is_not_comparable(
    baseline: Path, runs: Runs, stored: Stored
) -> None:
    anew = runs()
    anew.versions["depth"] = 2
    report = compare_stores(baseline, stored("anew", anew))
    assert (report.verdict, report.exit_code) == ("not comparable", 3)
    found = check(report, "depth no worse")
    assert found.outcome == "skipped"
    assert found.message == "its definition changed from version 1 to 2"
    assert check(report, "grip no worse").outcome == "passed"
