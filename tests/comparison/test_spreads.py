"""Stores of a changed model: one run decides nothing, and a shift of all runs fails the job."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.comparison.conftest import Given, eight, write

from contactlab.comparison.compare_stores import compare_stores
from contactlab.comparison.spread_checks import spread_finding
from contactlab.judge.policies import EffectiveRule
from contactlab.judge.subjects import Subject
from contactlab.schema.comparison import ComparePolicy
from contactlab.schema.finding import Finding
from contactlab.store.run_columns import NumberColumn


def seeded(scene: str, seeds: int = 3, *, moved: int = 3) -> Given:
    """Return runs of eight settings with seeds, of a scene of this hash.

    Every seed moves them in its own way, or only each of the first ones `moved`, which the others
    repeat.
    """
    given = eight()
    runs = [
        run.model_copy(
            update={
                "run_id": f"{scene}{seed:07x}{run.index:08x}"[:16],
                "index": run.index * seeds + seed,
                "scene_hash": scene,
                "seed": seed,
                "trajectory_hash": f"{run.index * moved + seed % moved:032x}",
            }
        )
        for run in given.runs
        for seed in range(seeds)
    ]
    return Given(runs, {"scene_hash": scene})


def outcome(findings: tuple[Finding, ...], name: str) -> str:
    return next(found.outcome for found in findings if found.name == name)


@pytest.fixture
def before(tmp_path: Path) -> Path:
    return write(tmp_path / "before", seeded("a"))


def test_one_run_with_a_new_label_fails_no_job(before: Path, tmp_path: Path) -> None:
    changed = seeded("b")
    changed.label(5, "chatter")
    after = write(tmp_path / "after", changed)
    report = compare_stores(before, after)
    assert (report.judge, report.match, report.exit_code) == ("spread", "axes", 0)
    assert outcome(report.findings, "no more chatter") == "passed"
    each = compare_stores(before, after, ComparePolicy(version=1, judge="each"))
    assert (each.exit_code, outcome(each.findings, "no new chatter")) == (1, "failed")


@pytest.mark.parametrize("names", [(), ("metric_versions",), ("scene_hash",)])
def test_a_changed_model_is_a_difference_whatever_the_policy_names(
    names: tuple[str, ...], before: Path, tmp_path: Path
) -> None:
    after = write(tmp_path / "after", seeded("b"))
    require = {"same": names, "warn_if_different": ()}
    policy = ComparePolicy.model_validate({"version": 1, "require": require})
    report = compare_stores(before, after, policy)
    assert [(each.what, each.required) for each in report.differences] == [("scene_hash", False)]
    again = compare_stores(before, write(tmp_path / "again", seeded("a")), policy)
    assert not again.differences


def test_a_label_of_many_runs_fails_the_job(before: Path, tmp_path: Path) -> None:
    changed = seeded("b")
    for index in range(0, 24, 3):
        changed.label(index, "chatter")
    report = compare_stores(before, write(tmp_path / "after", changed))
    assert (report.exit_code, outcome(report.findings, "no more chatter")) == (1, "failed")


@pytest.mark.parametrize(
    ("labels", "runs", "code"),
    [(("chatter",), 5, 0), (("chatter",), 6, 1), (("chatter", "tunneling"), 6, 0)],
)
def test_labels_of_few_runs_may_be_chance(
    before: Path, tmp_path: Path, labels: tuple[str, ...], runs: int, code: int
) -> None:
    """Of six changes by chance, all are for the worse in 1 of 64, and for the better in as many.

    That is less than 5 %, but not less than the 2.5 % that each of two labels may have.
    """
    changed = seeded("b")
    for index in range(runs):
        changed.label(index, *labels)
    report = compare_stores(before, write(tmp_path / "after", changed))
    assert report.exit_code == code
    (found,) = (each for each in report.findings if each.name == "no more chatter")
    assert found.message.startswith(f"{runs} of 24 runs newly chatter, 0 no longer: ")


@pytest.mark.parametrize(("runs", "code"), [(5, 0), (6, 1)])
def test_equal_runs_count_once(tmp_path: Path, runs: int, code: int) -> None:
    """Each of 24 runs twice: 10 new labels are those of 5 runs, which chance explains."""
    stores = dict[str, Path]()
    for scene in "ab":
        given = seeded(scene, seeds=6)
        for place, run in enumerate(given.runs if scene == "b" else ()):
            if int(run.trajectory_hash or "", 16) < runs:
                given.label(place, "chatter")
        stores[scene] = write(tmp_path / scene, given)
    report = compare_stores(stores["a"], stores["b"])
    assert (report.judge, report.pairs.paired, report.exit_code) == ("spread", 48, code)
    (found,) = (each for each in report.findings if each.name == "no more chatter")
    assert found.message.startswith(f"{runs} of 24 runs newly chatter, 0 no longer: ")


def test_repeats_of_few_runs_do_not_make_many(tmp_path: Path) -> None:
    one, other = (write(tmp_path / scene, seeded(scene, seeds=6, moved=1)) for scene in "ab")
    assert compare_stores(one, other).judge == "each"


@pytest.mark.parametrize(("shift", "code"), [(1.0, 0), (1.05, 1)])
def test_a_shift_beyond_the_noise_fails_the_job(
    before: Path, tmp_path: Path, shift: float, code: int
) -> None:
    changed, rng = seeded("b"), np.random.default_rng(1)
    for index in range(24):
        changed.measure(index, depth=1e-3 * shift * (1 + 0.02 * rng.standard_normal()))
    report = compare_stores(before, write(tmp_path / "after", changed))
    assert report.exit_code == code


def test_the_same_model_is_judged_run_by_run(before: Path, tmp_path: Path) -> None:
    changed = seeded("a")
    changed.label(5, "chatter")
    report = compare_stores(before, write(tmp_path / "after", changed))
    assert (report.judge, report.exit_code) == ("each", 1)


def found_in(before: Any, after: Any) -> str:
    columns = (NumberColumn(np.asarray(x), np.ones(len(x), np.bool_)) for x in (before, after))
    subject, rule = Subject("x no worse", "metrics", "gate"), EffectiveRule("lower", 1e-6, 0.01)
    return spread_finding(subject, rule, *columns, sure=0.95).outcome


def test_noise_alone_seldom_fails() -> None:
    """At 95 %, in at most 1 of 20 comparisons of equal models, by more than the tolerance."""
    rng = np.random.default_rng(7)
    failed = sum(
        found_in(*np.exp(0.3 * rng.standard_normal((2, 20)))) == "failed" for _ in range(400)
    )
    # 2.5 % on this side; 400 draws have 10 +- 3.
    assert failed <= 20


def test_few_values_may_be_missing_by_chance() -> None:
    """Of n lost values, all lost on one side have a chance of 2 / 2^n: 5 % takes six."""
    values = NumberColumn(np.ones(46), np.ones(46, np.bool_))
    subject, rule = Subject("x no worse", "metrics", "gate"), EffectiveRule("lower", 1e-6, 0.01)
    for sure, least in ((0.95, 6), (1 - 0.05 / 40, 11)):
        for lost_count in range(47):
            after = NumberColumn(values.values, np.arange(46) >= lost_count)
            finding = spread_finding(subject, rule, values, after, sure)
            assert (finding.verdict == "missing") == (lost_count >= least), lost_count


def test_values_that_are_lost_are_worse_than_any() -> None:
    assert found_in(np.ones(12), np.full(12, np.inf)) == "failed"
    assert found_in(np.full(12, np.nan), np.ones(12)) == "noted"


def test_runs_that_cannot_change_hide_no_change() -> None:
    """Three of four runs do not slide, or differ by rounding; in the others, all slip 3 % more."""
    still = np.zeros(60)
    noise = np.random.default_rng(3).random((2, 60))
    slip = np.linspace(0.01, 0.02, 20)
    for rest in ((still, still), 1e-12 * noise, (np.ones(60), np.ones(60)), 1 + 1e-6 * noise):
        more = found_in(*(np.r_[a, b] for a, b in zip(rest, (slip, 1.03 * slip), strict=True)))
        assert more == "failed"
    few = slip * np.r_[np.full(3, 1.03), np.ones(17)]
    assert found_in(np.r_[still, slip], np.r_[still, few]) == "passed"


def test_equal_values_keep_the_rate_of_false_alarms() -> None:
    """If half of the pairs are equal, still at most 1 of 20 comparisons fails by chance."""
    rng = np.random.default_rng(8)
    failed = 0
    for _ in range(400):
        before, after = np.exp(0.3 * rng.standard_normal((2, 40)))
        failed += found_in(before, np.where(rng.random(40) < 0.5, before, after)) == "failed"
    assert failed <= 20
