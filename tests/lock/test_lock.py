"""What a lock accepts, and what turns it red."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy import stats
from tests import push_env
from tests.push_env import PUSHED
from typer.testing import CliRunner

import contactlab
from contactlab.command_line.main import command_line
from contactlab.comparison.compare_stores import DEFAULT_POLICY
from contactlab.errors import ContactlabError, SweepFileError
from contactlab.schema.comparison import ComparePolicy, ComparisonReport
from contactlab.store.finished_store import Store
from contactlab.studies.lock.judgement import change_by_chance, judge_lock
from contactlab.studies.lock.lock_file import gated_metrics, lock_of, read_lock, write_lock
from contactlab.studies.lock.lock_model import Lock

SLIDE: dict[str, Any] = {
    "version": 1,
    "scene": "box_slide",
    "duration": 0.6,
    "seeds": 3,
    "axes": {"cone": ["pyramidal", "elliptic"]},
}
DROP: dict[str, Any] = {
    "version": 1,
    "scene": "ball_drop",
    "duration": 0.3,
    "seeds": 8,
    "axes": {"timestep": [1e-3, 2e-3], "drop_height": [0.02]},
}
PUSH: dict[str, Any] = {
    "version": 1,
    "scene": {"environment": f"{push_env.__file__}:Push"},
    "duration": 0.2,
    "seeds": 10,
    "axes": {"friction.slide": [0.5]},
}
Swept = Callable[..., Store]


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Swept:
    """Run a sweep with settings of its own."""

    def run(sweep: Mapping[str, Any], **settings: Any) -> Store:
        folder = tmp_path_factory.mktemp("store") / "store"
        sweep = {**sweep, **settings}
        return contactlab.sweep(sweep, output=folder, workers=0, allow_code=True)

    return run


@pytest.fixture(scope="module")
def slid(swept: Swept) -> Store:
    return swept(SLIDE)


@pytest.fixture(scope="module")
def dropped(swept: Swept) -> Store:
    return swept(DROP)


def frozen(store: Store, **how: Any) -> Lock:
    return lock_of(store, gated_metrics(store, DEFAULT_POLICY), **how)


def judged(lock: Lock, store: Store, policy: ComparePolicy = DEFAULT_POLICY) -> ComparisonReport:
    return judge_lock(lock, "the lock", store, policy)


def failing(report: ComparisonReport) -> set[str]:
    return {each.name for each in report.findings if each.outcome == "failed"}


def axes(sweep: Mapping[str, Any], **more: Any) -> dict[str, Any]:
    return {"axes": {**sweep["axes"], **more}}


def test_a_lock_is_read_as_it_was_written(slid: Store, tmp_path: Path) -> None:
    made = frozen(slid)
    write_lock(tmp_path / "locks" / "slide.lock.yaml", made, "slide")
    assert read_lock(tmp_path / "locks" / "slide.lock.yaml") == made
    lines = (tmp_path / "locks" / "slide.lock.yaml").read_text().splitlines()
    groups = [line for line in lines if line.startswith("- ")]
    assert len(groups) == len(SLIDE["axes"]["cone"])
    assert all("slip_distance" in line and "stable: 3" in line for line in groups)


def test_repeated_runs_are_as_locked_bit_for_bit(slid: Store, swept: Swept) -> None:
    report = judged(frozen(slid), swept(SLIDE))
    assert report.exit_code == 0
    assert report.pairs.bitwise_equal == report.pairs.paired == 6
    assert "by repetition" in report.headline


def test_more_friction_is_seen(slid: Store, swept: Swept) -> None:
    more = swept(SLIDE, **axes(SLIDE, **{"friction.slide": [0.5 * 1.2]}))
    report = judged(frozen(slid), more)
    assert report.exit_code == 1
    assert "slip_distance as locked" in failing(report)
    slip = next(each for each in report.findings if each.name == "slip_distance as locked")
    # Run ids name the runs that show it.
    assert slip.worst[0].candidate_run in set(more.table["run_id"].to_pylist())


@pytest.mark.long
def test_another_integrator_is_seen_where_it_matters(dropped: Store, swept: Swept) -> None:
    report = judged(frozen(dropped), swept(DROP, **axes(DROP, integrator=["RK4"])))
    assert report.exit_code == 1


def test_other_seeds_are_as_locked(dropped: Store, swept: Swept) -> None:
    others = swept(DROP, seeds=list(range(100, 112)))
    report = judged(frozen(dropped), others)
    assert report.exit_code == 0
    assert "by the spread" in report.headline
    assert report.pairs.bitwise_equal == 0


def test_other_seeds_of_another_environment_are_not(dropped: Store, swept: Swept) -> None:
    others = swept(DROP, seeds=list(range(100, 108)), **axes(DROP, drop_height=[0.1]))
    assert judged(frozen(dropped), others).exit_code == 1


def test_locked_seeds_of_what_is_chaotic_are_judged_by_spread(dropped: Store) -> None:
    made = frozen(dropped)
    (first, *rest) = made.groups
    measured = {name: values for name, values in first.metrics.items() if len(values) > 1}
    name = max(measured, key=lambda name: measured[name][1] / abs(measured[name][0]))
    mean, spread = measured[name]
    moved = {**first.metrics, name: (mean + 0.02 * abs(mean) + 0.1 * spread, spread)}
    groups = (first.model_copy(update={"metrics": moved}), *rest)
    assert judged(made.model_copy(update={"groups": groups}), dropped).exit_code == 1
    chaotic = made.model_copy(update={"groups": groups, "chaotic": True})
    assert judged(chaotic, dropped).exit_code == 0


@pytest.fixture(scope="module")
def pushed(swept: Swept) -> Store:
    return swept(PUSH)


@pytest.mark.long
@pytest.mark.parametrize(
    ("change", "exit_code"),
    [
        ({}, 0),
        ({"seeds": list(range(40, 52))}, 0),
        ({"friction.slide": [0.5 * 1.2]}, 1),
        ({"seeds": list(range(40, 52)), "friction.slide": [0.5 * 3]}, 1),
        ({"integrator": ["RK4"]}, 1),
    ],
)
def test_episodes_of_an_environment_are_judged_by_their_seeds(
    pushed: Store, swept: Swept, change: Mapping[str, Any], exit_code: int
) -> None:
    """All begin alike; actions are drawn by the seed."""
    others = {name: value for name, value in change.items() if name != "seeds"}
    seeds = {name: change[name] for name in change if name == "seeds"}
    again = swept(PUSH, **seeds, **axes(PUSH, **others))
    report = judged(frozen(pushed), again)
    assert report.exit_code == exit_code
    assert ("by repetition" in report.headline) == ("seeds" not in change)


@pytest.mark.long
def test_a_drive_draws_by_the_seed_too(swept: Swept, tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(PUSHED, encoding="utf-8")
    sweep = {"version": 1, "scene": str(tmp_path / "arm.xml"), "duration": 0.3, "seeds": 8}
    sweep |= {"drive": {"noise": 0.5, "rate": 50}, "axes": {"perturbation": [0.0]}}
    lock = frozen(swept(sweep))
    others = swept(sweep, seeds=list(range(40, 52)))
    assert "by the spread" in judged(lock, others).headline


@pytest.mark.long
def test_a_policy_says_what_counts(slid: Store, swept: Swept) -> None:
    policy = ComparePolicy.model_validate(
        {"version": 1, "metrics": {"*": {"level": "note"}, "slip_*": {"level": "gate", "rel": 0.5}}}
    )
    assert gated_metrics(slid, policy) == ["slip_distance"]
    more = swept(SLIDE, **axes(SLIDE, **{"friction.slide": [0.6]}))
    assert judged(frozen(slid), more, policy).exit_code == 0


def test_lost_groups_and_labels_are_seen(slid: Store) -> None:
    made = frozen(slid)
    added = made.groups[0].model_copy(update={"at": {"cone": "round"}})
    lost = made.model_copy(update={"groups": (*made.groups, added)})
    assert failing(judged(lost, slid)) == {"no missing groups"}
    (first, *rest) = made.groups
    moved = first.model_copy(update={"outcomes": {"stable": 2, "chatter": 1}})
    labels = made.model_copy(update={"groups": (moved, *rest)})
    report = judged(labels, slid)
    assert failing(report) == {"outcomes as locked"}
    (pair,) = next(each.worst for each in report.findings if each.name == "outcomes as locked")
    assert (pair.baseline, pair.candidate) == (
        "stable 2 of 3, chatter 1 of 3",
        "stable 3 of 3, chatter 0 of 3",
    )


@pytest.mark.long
def test_single_runs_of_other_starts_cannot_be_judged(swept: Swept) -> None:
    one, other = (swept(DROP, seeds=[seed]) for seed in (0, 1))
    report = judged(frozen(one), other)
    assert report.exit_code == 3
    assert "not comparable" in report.headline


@given(
    old=st.lists(st.floats(-1, 1).map(lambda value: round(value, 3)), min_size=2, max_size=9),
    new=st.lists(st.floats(-1, 1).map(lambda value: round(value, 3)), min_size=2, max_size=9),
)
def test_means_differ_by_chance_as_students_test_has_it(old: list[float], new: list[float]) -> None:
    """A difference at the edge of chance is one whose p-value in Student's test is alpha."""
    spreads = [(float(np.std(each, ddof=1)), len(each)) for each in (old, new)]
    means = [float(np.mean(each)) for each in (old, new)]
    assume(max(spread for spread, _ in spreads) > 0)
    (first, second), (before, after) = zip(means, spreads, strict=True), spreads
    test: Any = stats.ttest_ind_from_stats(*first[:1], *first[1], *second[:1], *second[1])
    assume(1e-6 < test.pvalue < 0.999)
    # The p-value and its inverse are each good to about 1e-9 in the range assumed.
    edge = change_by_chance(before, after, float(test.pvalue))
    assert edge == pytest.approx(abs(means[1] - means[0]), rel=1e-6, abs=1e-9)


@pytest.mark.long
def test_chance_alone_exceeds_a_tolerance_as_often_as_stated() -> None:
    """Of normal values, in a share alpha of checks; the count is within 4 standard deviations."""
    rng, rounds, n, m, alpha = np.random.default_rng(1), 4_000, 5, 9, 0.05
    changed = 0
    for row in rng.normal(3.0, 1.0, (rounds, n + m)):
        old, new = row[:n], row[n:]
        before, after = ((float(each.std(ddof=1)), len(each)) for each in (old, new))
        changed += abs(new.mean() - old.mean()) > change_by_chance(before, after, alpha)
    expected = alpha * rounds
    assert abs(changed - expected) < 4 * np.sqrt(expected * (1 - alpha))


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """Run a command of the package in an empty folder, and raise what it raises."""
    monkeypatch.chdir(tmp_path)
    app = command_line()

    def run(*words: str) -> Any:
        done = CliRunner().invoke(app, words)
        if isinstance(done.exception, ContactlabError):
            raise done.exception
        assert done.exit_code == 0, done.output
        return done.stdout

    return run


def test_a_store_is_locked_and_checked(slid: Store, command: Callable[..., Any]) -> None:
    out = command("lock", str(slid.address), "--file", "here.lock.yaml")
    assert "check them: contactlab lock" in out
    told = command("lock", str(slid.address), "--file", "here.lock.yaml", "--check", "-o", "a.xml")
    assert told.startswith("same: ")
    assert "<testsuites>" in Path("a.xml").read_text()
    report = command(
        "lock", str(slid.address), "--file", "here.lock.yaml", "--check", "--format", "json"
    )
    assert json.loads(report)["verdict"] == "same"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["lock", "nothing", "--check"], "there is no lock nothing.lock.yaml"),
        (["lock", "STORE", "--set", "timestep=1e-3"], "is a store; --set, --workers"),
        (["lock", "STORE", "--file", "damaged.yaml", "--check"], "damaged.yaml"),
        (["lock", "nothing"], "no sweep file and no shipped sweep named"),
        (["lock", "nothing", "-o", "my.lock.yaml"], "-o writes the report of --check; name the"),
        (["bisect", "slide", "--good", "3.2.7", "--bad", "4.0.0"], "3.3.4 and newer; 3.2.7 is"),
        (["bisect", "slide", "--good", "3.9", "--bad", "3.10.0", "--versions", "3.9.0"], "3.9"),
    ],
)
def test_bad_use_is_said(
    words: list[str], message: str, slid: Store, command: Callable[..., Any]
) -> None:
    Path("damaged.yaml").write_text("version: 1\ngroups: [{at: {}}]\n")
    given = [str(slid.address) if each == "STORE" else each for each in words]
    with pytest.raises(ContactlabError, match=message):
        command(*given)
    assert not list(Path().glob("*.lock.yaml"))


def test_a_group_stands_once(slid: Store, tmp_path: Path) -> None:
    made = frozen(slid)
    twice = made.model_copy(update={"groups": (*made.groups, made.groups[0])})
    write_lock(tmp_path / "twice.yaml", twice, "slide")
    with pytest.raises(SweepFileError, match="two groups of the same axis values"):
        read_lock(tmp_path / "twice.yaml")


def test_a_change_of_the_scene_is_told_before_what_follows_from_it(slid: Store) -> None:
    headline = judged(frozen(slid).model_copy(update={"scene_hash": "another"}), slid).headline
    assert headline.startswith("the scene changed since the lock; ")
    assert judged(frozen(slid), slid).headline.startswith("same: ")


def test_a_struck_metric_is_not_judged_in_silence(slid: Store, tmp_path: Path) -> None:
    whole = frozen(slid)
    data = whole.model_dump(mode="json")
    for group in data["groups"]:
        del group["metrics"]["slip_distance"]
    report = judged(Lock.model_validate(data), slid)
    (struck,) = (each for each in report.findings if each.name == "slip_distance as locked")
    assert (report.exit_code, struck.outcome) == (3, "skipped")
    del data["metric_versions"]["slip_distance"]
    report = judged(Lock.model_validate(data), slid)
    (struck,) = (each for each in report.findings if each.name == "slip_distance as locked")
    assert (report.exit_code, struck.outcome) == (0, "warned")
    one = whole.model_dump(mode="json")
    del one["groups"][1]["metrics"]["slip_distance"]
    assert "slip_distance as locked" in failing(judged(Lock.model_validate(one), slid))
    path = tmp_path / "a.lock.yaml"
    write_lock(path, whole.model_copy(update={"groups": ()}), "slide")
    with pytest.raises(SweepFileError, match="groups"):
        read_lock(path)
