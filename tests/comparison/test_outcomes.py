"""Shares of good outcomes: worse only where the interval of the difference says so."""

from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from contactlab.comparison.compare_stores import compare_stores, draw_conclusion
from contactlab.comparison.report import report_of
from contactlab.errors import PolicyError, StoreError
from contactlab.judge.subjects import MISSING, WORSE, Subject
from contactlab.judge.wording import with_interval
from contactlab.schema.comparison import ComparePolicy
from contactlab.schema.finding import Finding
from contactlab.shares import all_good, paired_difference, unpaired_difference

Runs = Callable[..., Any]
Stored = Callable[..., Path]
CASES = 60


@pytest.fixture
def outcome(many: Runs, stored: Stored) -> Callable[..., Finding | None]:
    """Return what is found if some of 60 cases fail in one store, and others in the other."""
    numbers = count()

    def compared(
        before: range, after: range, match: str = "id", cases: int = CASES, **rules: Any
    ) -> Finding | None:
        def written(failing: range, cases: int = CASES) -> Path:
            given = many(cases)
            for case in failing:
                given.label(case, "chatter")
            return stored(f"store {next(numbers)}", given)

        policy = ComparePolicy.model_validate({"version": 1, "match": match, "outcomes": rules})
        report = compare_stores(written(before), written(after, cases), policy)
        return next((each for each in report.findings if each.kind == "outcomes"), None)

    return compared


@pytest.mark.parametrize(
    ("after", "tolerance", "verdict"),
    [
        (range(24), 0.0, "worse"),  # 12 more fail, and none less: -.2, -.32 to -.12
        (range(24), 0.1, "worse"),
        (range(24), 0.15, "same"),
        (range(14), 0.0, "same"),  # 2 more: not distinguishable
        (range(2), 0.0, "better"),
        (range(10, 24), 0.0, "same"),  # 12 lost, 10 gained
    ],
)
def test_a_gate_fails_only_if_the_interval_excludes_what_is_tolerated(
    outcome: Callable[..., Finding], after: range, tolerance: float, verdict: str
) -> None:
    found = outcome(range(12), after, good="stable", tolerance=tolerance)
    assert found.verdict == verdict
    assert (found.outcome == "failed") == (verdict == "worse")
    gained, lost = len({*range(12)} - {*after}), len({*after} - {*range(12)})
    low, high = paired_difference(gained, lost, CASES)
    assert (high < -tolerance, low > 0) == (verdict == "worse", verdict == "better")
    assert f"{CASES - len(after)} of {CASES}, 48 in the baseline" in found.message


def test_how_many_more_would_tell(outcome: Callable[..., Finding]) -> None:
    found = outcome(range(12), range(10, 24), good="stable")
    assert "not distinguishable; about " in found.message
    assert "pairs would show it" in found.message
    same = outcome(range(12), range(12), good="stable")
    assert same.message.count("not distinguishable") == 1
    assert "would show it" not in same.message


def test_the_answer_is_told_where_nothing_fails(many: Runs, stored: Stored) -> None:
    """Checks that pass are counted, and this one is what was asked."""
    given = many(CASES)
    given.label(0, "chatter")
    policy = ComparePolicy.model_validate({"version": 1, "outcomes": {"good": "stable"}})
    report = compare_stores(stored("one", many(CASES)), stored("other", given), policy)
    told = [text for name, text in report_of(report).facts if name == "outcomes"]
    (finding,) = (each for each in report.findings if each.kind == "outcomes")
    assert told == [f"no less stable: {finding.message}"]
    assert "not distinguishable" in told[0]


def test_runs_that_call_nothing_a_success_are_not_counted(outcome: Callable[..., None]) -> None:
    assert outcome(range(12), range(24)) is None


@pytest.mark.parametrize(
    ("after", "cases", "verdict"),
    [
        (range(24), 60, "same"),  # 48 of 60, then 36: -.35 to -.03 excludes none but 0
        (range(30), 60, "worse"),
        (range(2), 90, "better"),
        (range(14), 70, "same"),
    ],
)
def test_without_pairs_the_interval_is_that_of_two_shares(
    outcome: Callable[..., Finding], after: range, cases: int, verdict: str
) -> None:
    found = outcome(range(12), after, "none", cases, good="stable", tolerance=0.05)
    assert found.verdict == verdict
    good = cases - len(after)
    low, high = unpaired_difference(good, cases, 48, 60)
    assert (high < -0.05, low > 0) == (verdict == "worse", verdict == "better")
    assert f"{good} of {cases}, 48 of 60 in the baseline" in found.message
    assert ("not distinguishable" in found.message) == (low <= 0 <= high)


def test_a_control_takes_the_place_of_the_baseline(many: Runs, stored: Stored) -> None:
    """12 of 60 fail in the baseline, 24 in control and candidate: what changed is the loop.

    Without a control the candidate is to blame; a control as the baseline changes nothing.
    """

    def of(name: str, failing: range) -> Path:
        given = many(CASES)
        for case in failing:
            given.label(case, "chatter")
        return stored(name, given)

    rules = {"good": "stable"}
    policy = ComparePolicy.model_validate({"version": 1, "outcomes": rules})
    before, after = of("before", range(12)), of("after", range(24))
    moved, kept = of("moved", range(24)), of("kept", range(12))

    def outcomes(control: Path | None) -> dict[str, Finding]:
        report = compare_stores(before, after, policy, control=control)
        assert (report.control is None) == (control is None)
        return {each.name: each for each in report.findings if each.kind == "outcomes"}

    alone = outcomes(None)
    assert [*alone] == ["no less stable"]
    assert alone["no less stable"].outcome == "failed"
    found = outcomes(moved)
    assert found["no less stable"].verdict == "same"
    assert "36 in the control" in found["no less stable"].message
    assert found["control as the baseline"].verdict == "changed"
    assert found["control as the baseline"].outcome == "warned"
    found = outcomes(kept)
    assert found["no less stable"].verdict == "worse"
    assert found["control as the baseline"].verdict == "same"
    with pytest.raises(PolicyError, match="the same store"):
        compare_stores(before, after, policy, control=before)


def test_pass_k_is_of_settings_where_each_has_so_many_runs(outcome: Callable[..., Finding]) -> None:
    """These stores have a run of each setting: all of them together are drawn from."""
    found = outcome(range(12), range(24), good="stable", in_a_row=2)
    share, low, high = all_good(2, [(36, 60)])
    assert f"pass^2 {with_interval(share, low, high)} and " in found.message
    assert "pass^" not in outcome(range(12), range(24), good="stable", in_a_row=61).message


def test_without_pairs_runs_must_say_how_they_ended(outcome: Callable[..., None]) -> None:
    with pytest.raises(StoreError, match="good: stable"):
        outcome(range(12), range(24), "none")


@pytest.mark.parametrize(
    ("kinds", "word"),
    [
        ({"metrics": MISSING}, "values missing"),
        ({"metrics": MISSING, "labels": WORSE}, "worse"),
        ({"runs": MISSING, "labels": WORSE}, "runs missing"),
    ],
)
def test_a_missing_value_is_no_headline_beside_worse_runs(kinds: dict[str, int], word: str) -> None:
    checks = [
        Subject(f"no less {kind}", kind, "gate").make_single(code, "")
        for kind, code in kinds.items()
    ]
    _, code, headline = draw_conclusion(checks)
    assert code == 1
    assert headline.startswith(f"{word}: {len(kinds)} of {len(kinds)} check")
