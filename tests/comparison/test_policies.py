"""Policy files: the closest rule wins, mistakes have places, comments survive."""

from collections.abc import Callable
from datetime import date
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contactlab.comparison.compare_stores import compare_stores
from contactlab.errors import PolicyError, SweepFileError
from contactlab.judge.policies import effective_rule, kind_of
from contactlab.judge.waivers import add_waivers, waivers_for
from contactlab.plan.sweep_file import read_yaml_as
from contactlab.schema.comparison import ComparePolicy
from contactlab.schema.finding import Waiver
from contactlab.store.table_layout import REAL, Column

Runs = Callable[[], Any]
Stored = Callable[..., Path]
read_policy = partial(read_yaml_as, kind=ComparePolicy)
POLICY = """\
# Waivers of our robot.
version: 1
match: axes   # the scene is edited daily
metrics:
  "*": {rel: 2%}
  depth: {abs: 1.0e-5, level: warn}  # soft pads
labels:
  allow:
    - {from: chatter, to: stable, max: 40, reason: boundary moved, until: 2027-03-01}
"""


def test_a_policy_is_read(tmp_path: Path) -> None:
    path = tmp_path / "policy.yaml"
    path.write_text(POLICY)
    policy = read_policy(path)
    assert policy.match == "axes"
    (allowed,) = policy.labels.allow
    assert (allowed.from_, allowed.until) == ("chatter", date(2027, 3, 1))
    rule = effective_rule(Column("depth", REAL, "m", "", "lower", 1e-9), policy)
    assert (rule.rel, rule.abs, rule.level, rule.budget) == (0.02, 1e-5, "warn", 0.02)


def test_the_closest_rule_wins_field_by_field() -> None:
    policy = ComparePolicy.model_validate(
        {"version": 1, "metrics": {"depth": {"rel": 0.2}, "d*": {"rel": 0.1, "budget": 0.5}}}
    )
    rule = effective_rule(Column("depth", REAL, "m", "", "lower", 1e-3), policy)
    assert (rule.better, rule.rel, rule.budget) == ("lower", 0.2, 0.5)
    # The resolution is the least change that a value can show.
    assert rule.abs == 1e-3


@pytest.mark.parametrize(
    ("name", "statistic", "level", "kind"),
    [
        ("depth", "each", "gate", "metrics"),
        ("solver_iterations", "mean", "gate", "metrics"),
        ("work_contacts", "mean", "gate", "metrics"),
        ("cost_cpu_per_sim_s", "ratio", "warn", "time"),
        ("time_median", "ratio", "warn", "time"),
        ("step_p99", "ratio", "warn", "time"),
    ],
)
def test_work_gates_and_time_warns(name: str, statistic: str, level: str, kind: str) -> None:
    measured = Column(name, REAL, "1", "", "lower")
    rule = effective_rule(measured, ComparePolicy(version=1))
    assert (rule.statistic, rule.level, kind_of(name)) == (statistic, level, kind)
    assert ("cpu_model" in rule.needs_same) == (kind == "time")


def test_a_rule_for_all_leaves_the_special_ones() -> None:
    policy = ComparePolicy.model_validate({"version": 1, "metrics": {"*": {"rel": 0.03}}})
    rels = {
        name: effective_rule(Column(name, REAL, "1", "", "lower"), policy).rel
        for name in ("depth", "cost_cpu_per_sim_s", "solver_iterations_max")
    }
    assert rels == {"depth": 0.03, "cost_cpu_per_sim_s": 0.15, "solver_iterations_max": 0.05}


def test_all_mistakes_at_once_with_their_places(tmp_path: Path) -> None:
    path = tmp_path / "policy.yaml"
    path.write_text("version: 1\nmetric: {}\nmetrics:\n  depth: {rell: 1, level: fail}\n")
    with pytest.raises(SweepFileError) as raised:
        read_policy(path)
    text = str(raised.value)
    for part in (
        "unknown key 'metric'",
        "did you mean 'metrics'?",
        "policy.yaml:2:1",
        "unknown key 'rell'",
        "did you mean 'rel'?",
        "policy.yaml:4:11",
        "'level' must be 'gate', 'warn' or 'note'",
    ):
        assert part in text
    assert raised.value.exit_code == 2


@pytest.mark.parametrize(
    "line",
    [
        "waive: [{check: x, max: 1}]",
        "waive: [{check: x, max: 1, reason: ''}]",
        "labels: {allow: [{from: a, to: b, max: 1}]}",
        "labels: {severity: [a, a]}",
        "metrics: {depth: {rel: -1}}",
        "expectations: fatal",
    ],
)
def test_what_no_policy_may_say(tmp_path: Path, line: str) -> None:
    path = tmp_path / "policy.yaml"
    path.write_text(f"version: 1\n{line}\n")
    with pytest.raises(SweepFileError, match=r"policy\.yaml:2"):
        read_policy(path)


def test_waiving_keeps_the_comments_of_the_file(
    tmp_path: Path, baseline: Path, runs: Runs, stored: Stored
) -> None:
    path = tmp_path / "policy.yaml"
    path.write_text(POLICY)
    worse = runs()
    worse.measure(0, slip=0.6)
    candidate = stored("worse", worse)
    report = compare_stores(baseline, candidate, read_policy(path))
    add_waivers(
        path,
        waivers_for(report.findings, "slip unchanged", " pads were replaced ", date(2027, 1, 1)),
    )
    text = path.read_text()
    for line in POLICY.splitlines():
        assert line.partition("#")[2] in text
    (entry,) = read_policy(path).waive
    assert (entry.check, entry.max, entry.reason) == ("slip unchanged", 1, "pads were replaced")
    assert (
        compare_stores(baseline, candidate, read_policy(path), today=date(2027, 1, 1)).exit_code
        == 0
    )
    worse.measure(1, slip=0.6)
    again = compare_stores(
        baseline, stored("more", worse), read_policy(path), today=date(2026, 1, 1)
    )
    add_waivers(path, waivers_for(again.findings, "slip unchanged", "both were", None))
    (entry,) = read_policy(path).waive
    assert (entry.max, entry.reason, entry.until) == (2, "both were", None)


def test_waiving_creates_a_missing_file(
    tmp_path: Path, baseline: Path, runs: Runs, stored: Stored
) -> None:
    worse = runs()
    worse.measure(0, depth=2e-3)
    report = compare_stores(baseline, stored("worse", worse))
    path = tmp_path / "new.yaml"
    add_waivers(path, waivers_for(report.findings, "depth no worse", "known", None))
    assert [entry.check for entry in read_policy(path).waive] == ["depth no worse"]


@pytest.mark.parametrize(
    ("name", "reason", "message"),
    [
        ("depth no worse", " ", "needs a reason"),
        ("depth no wors", "x", "there is no check 'depth no wors'; did you mean 'depth no worse'?"),
        ("depth no worse", "x", "did not fail"),
    ],
)
def test_waivers_that_are_refused(
    baseline: Path, runs: Runs, stored: Stored, name: str, reason: str, message: str
) -> None:
    report = compare_stores(baseline, stored("same", runs()))
    with pytest.raises(PolicyError) as raised:
        waivers_for(report.findings, name, reason, None)
    assert message in str(raised.value)


NAMES = st.sampled_from(["no new chatter", "depth", "grip"])
ACCEPTED = st.builds(
    Waiver,
    check=NAMES,
    group=st.sampled_from([None, "a", "b"]),
    max=st.integers(1, 9),
    reason=st.sampled_from(["softer", "known: see the note", "'quoted'"]),
    until=st.none() | st.dates(),
)


@settings(max_examples=10)
@given(st.lists(st.lists(ACCEPTED, min_size=1, max_size=2), min_size=1, max_size=4))
def test_a_waiver_stays_until_it_is_replaced(
    tmp_path_factory: pytest.TempPathFactory, times: list[list[Waiver]]
) -> None:
    """One entry for each check and group, the last one given; what else the file says stays."""
    path = tmp_path_factory.mktemp("policy") / "policy.yaml"
    path.write_text("# Ours.\nversion: 1\nlabels: {level: warn}\n")
    expected = dict[tuple[str, str | None], Waiver]()
    for entries in times:
        add_waivers(path, entries)
        for entry in entries:
            expected.pop((entry.check, entry.group), None)
            expected[entry.check, entry.group] = entry
    policy = read_yaml_as(path, ComparePolicy)
    assert list(policy.waive) == [*expected.values()]
    assert policy.labels.level == "warn"
    assert path.read_text().startswith("# Ours.\n")
