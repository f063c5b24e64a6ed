"""Planted changes of labels: the right verdict, the right exit code, a line that says it."""

from collections.abc import Callable
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import pytest

from contactlab.comparison.compare_stores import compare_stores
from contactlab.comparison.report import report_of
from contactlab.measure import LABELS
from contactlab.schema.comparison import ComparePolicy, ComparisonReport
from contactlab.schema.finding import Finding
from contactlab.writers import as_text

Runs = Callable[[], Any]
Stored = Callable[..., Path]
LOOKED_FOR = {"version": 1, "scene": "ball", "thresholds": {}, "knife_edge": True}


def policy(**changes: Any) -> ComparePolicy:
    return ComparePolicy.model_validate({"version": 1, **changes})


def check(report: ComparisonReport, name: str, group: str = "") -> Finding:
    (found,) = [each for each in report.findings if (each.name, each.group) == (name, group)]
    return found


@pytest.mark.parametrize("labels", [["tunneling"], ["tunneling", "chatter"]])
def test_one_flipped_label(baseline: Path, runs: Runs, stored: Stored, labels: list[str]) -> None:
    flipped = runs()
    flipped.label(5, *labels)
    report = compare_stores(baseline, stored("flipped", flipped))
    assert (report.verdict, report.exit_code) == ("worse", 1)
    for label in labels:
        found = check(report, f"no new {label}")
        assert (found.outcome, found.message) == ("failed", f"1 of 8 runs newly {label}")
    assert "label      stable -> tunneling: 1 run\n" in as_text(report_of(report))


def test_a_label_that_only_the_column_tells(baseline: Path, runs: Runs, stored: Stored) -> None:
    """A table whose list of labels was left as it was is not believed."""
    flipped = runs()
    flipped.change(5, label="diverged")
    report = compare_stores(baseline, stored("flipped", flipped))
    assert check(report, "no new diverged").outcome == "failed"


def test_a_milder_label_is_better(runs: Runs, stored: Stored) -> None:
    before, after = runs(), runs()
    before.label(0, "diverged")
    after.label(0, "chatter")
    report = compare_stores(stored("before", before), stored("after", after))
    assert (report.verdict, report.exit_code) == ("changed", 0)
    assert check(report, "no new diverged").message == "1 of 8 runs no longer diverged"
    message = "1 run newly chatter, but better on the whole"
    assert check(report, "no new chatter").message == message


def test_a_label_nobody_knows_is_taken_for_the_worst(
    baseline: Path, runs: Runs, stored: Stored
) -> None:
    strange = runs()
    strange.label(0, "haunted")
    report = compare_stores(baseline, stored("strange", strange))
    assert check(report, "no new haunted").outcome == "failed"
    assert report.findings.index(check(report, "no new haunted")) < report.findings.index(
        check(report, "no new crashed")
    )


def test_an_allowed_transition_and_past_its_date(
    baseline: Path, runs: Runs, stored: Stored
) -> None:
    moved = runs()
    moved.label(0, "chatter")
    candidate = stored("moved", moved)
    entry = {"from": "stable", "to": "chatter", "max": 1, "reason": "known", "until": "2026-06-30"}
    rules = policy(labels={"allow": [entry]})
    report = compare_stores(baseline, candidate, rules, today=date(2026, 6, 30))
    found = check(report, "no new chatter")
    assert (report.exit_code, found.outcome) == (0, "noted")
    assert found.message == "1 run newly chatter, as the policy allows"
    report = compare_stores(baseline, candidate, rules, today=date(2026, 7, 1))
    found = check(report, "no new chatter")
    assert (report.exit_code, found.outcome) == (1, "failed")
    assert found.message.endswith("stable -> chatter was allowed until 2026-06-30 (known)")
    moved.label(1, "chatter")
    report = compare_stores(baseline, stored("more", moved), rules, today=date(2026, 1, 1))
    found = check(report, "no new chatter")
    assert (report.exit_code, found.failing) == (1, 2)
    assert "allowed for 1 run, but 2 do so (known)" in found.message


def test_knife_edge_runs_gate_nothing_and_are_counted(runs: Runs, stored: Stored) -> None:
    before, after = runs(), runs()
    for index in range(8):
        before.change(index, knife_edge=index == 0)
        after.change(index, knife_edge=index == 0)
    for given in (before, after):
        given.identity["resolved"] = LOOKED_FOR
    after.label(0, "tunneling")
    after.measure(0, depth=1.0)
    stores = stored("before", before), stored("after", after)
    report = compare_stores(*stores)
    assert report.exit_code == 0
    assert (report.pairs.knife_edge, report.pairs.knife_edge_flipped) == (1, 1)
    assert "1 knife-edge (1 with another label now)" in as_text(report_of(report))
    strict = compare_stores(*stores, policy(knife_edge={"exclude": False}))
    assert strict.exit_code == 1


def test_many_more_knife_edge_runs_are_told(runs: Runs, stored: Stored) -> None:
    before, after = runs(), runs()
    for index in range(8):
        before.change(index, knife_edge=False)
        after.change(index, knife_edge=index < 2)
    for given in (before, after):
        given.identity["resolved"] = LOOKED_FOR
    one, two = stored("before", before), stored("after", after)
    found = check(compare_stores(one, two), "few knife-edge runs")
    assert (found.outcome, found.verdict) == ("warned", "worse")
    assert check(compare_stores(two, one), "few knife-edge runs").outcome == "passed"


def test_expectations(runs: Runs, stored: Stored) -> None:
    before, after = runs(), runs()
    before.change(0, expected=("stable",), expectation_met=True)
    after.change(0, expected=("stable",), expectation_met=False)
    one, two = stored("before", before), stored("after", after)
    report = compare_stores(one, two)
    assert (report.verdict, report.exit_code) == ("worse", 1)
    assert check(report, "expectations still met").message == "0 of 1 run within expectations"
    assert compare_stores(two, one).exit_code == 0


def test_other_thresholds_make_other_labels(baseline: Path, runs: Runs, stored: Stored) -> None:
    other = runs()
    other.identity["resolved"] = {"thresholds": {"chatter": 9.0}}
    report = compare_stores(baseline, stored("other", other))
    assert report.exit_code == 3
    message = "thresholds differ: chatter by default, now chatter 9.0"
    assert check(report, "no new chatter").message == message


DEMANDS = {
    "must": ["still(box, 5 cm)"],
    "expect": [{"label": ["stable"]}],
    "tolerances": {"depth": 1e-3},
}


@pytest.mark.parametrize("name", DEMANDS)
def test_changed_demands_are_not_comparable(
    baseline: Path, runs: Runs, stored: Stored, name: str
) -> None:
    """A gate cannot be weakened between two stores without a word."""
    changed = runs()
    resolved = {"version": 1, "scene": "ball", "checks": "flagged", "thresholds": {}}
    changed.identity["resolved"] = {**resolved, name: DEMANDS[name]}
    report = compare_stores(baseline, stored("changed", changed))
    assert (report.verdict, report.exit_code) == ("not comparable", 3)
    message = check(report, "same demands").message
    assert message.startswith(f"must be the same, but is {name} by default, now {name} ")
    told = policy(require={"same": [], "warn_if_different": ["demands"]})
    report = compare_stores(baseline, stored("again", changed), told)
    assert (report.exit_code, check(report, "same demands").outcome) == (0, "warned")


def test_no_store_decides_the_order_of_known_labels(
    baseline: Path, runs: Runs, stored: Stored, monkeypatch: pytest.MonkeyPatch
) -> None:
    reversed_order = ("stable", "own", "chatter", "creep", "tunneling", "diverged")
    monkeypatch.setattr("tests.comparison.conftest.SEVERITY", reversed_order)
    flipped = runs()
    flipped.label(5, "tunneling")
    report = compare_stores(baseline, stored("flipped", flipped))
    assert (report.verdict, report.exit_code) == ("worse", 1)


def test_the_worst_runs_of_a_label_are_shown(
    baseline: Path, runs: Runs, stored: Stored, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are those deepest, and more than are shown have the label."""
    judged = replace(LABELS["tunneling"], judged_on=(("depth", ""),))
    monkeypatch.setitem(LABELS, "tunneling", judged)
    deep = runs()
    depths = [1.0, 4.0, 2.0, 7.0, 3.0, 6.0, 5.0]
    for index, depth in enumerate(depths):
        deep.label(index, "tunneling")
        deep.measure(index, depth=depth)
    found = check(compare_stores(baseline, stored("deep", deep)), "no new tunneling")
    shown = [int(pair.candidate_run or "0", 16) - 1 for pair in found.worst]
    assert shown == [3, 5, 6, 1, 4]
