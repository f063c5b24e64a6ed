"""The baseline's recommendation holds while it is feasible and nothing is far cheaper."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from contactlab.comparison.compare_stores import compare_stores
from contactlab.schema.comparison import ComparePolicy
from contactlab.schema.finding import Finding

Runs = Callable[[], Any]
Stored = Callable[..., Path]


@pytest.fixture
def weighed(runs: Runs) -> Callable[..., Any]:
    """Return runs of which larger timesteps cost less, with a tolerance that all meet."""

    def make() -> Any:
        given_runs = runs()
        for index in range(8):
            given_runs.cost(index, 1e-3)
        axes = {"cone": ["elliptic", "pyramidal"], "timestep": [1e-3, 2e-3, 4e-3, 8e-3]}
        given_runs.identity["resolved"] = {
            "version": 1,
            "scene": "ball",
            "axes": axes,
            "tolerances": {"depth": 2e-3},
        }
        return given_runs

    return make


def checked(baseline: Path, candidate: Path) -> Finding:
    policy = ComparePolicy.model_validate({"version": 1, "recommendation": {"changed": "gate"}})
    checks = compare_stores(baseline, candidate, policy).findings
    (found,) = [check for check in checks if check.kind == "recommendation"]
    return found


def test_it_holds(weighed: Runs, stored: Stored) -> None:
    found = checked(stored("before", weighed()), stored("after", weighed()))
    assert (found.outcome, found.verdict) == ("passed", "same")
    assert "timestep=0.008" in found.message


def test_it_is_not_feasible_any_more(weighed: Runs, stored: Stored) -> None:
    after = weighed()
    for index in (3, 7):
        after.measure(index, depth=3e-3)
    found = checked(stored("before", weighed()), stored("after", after))
    assert (found.outcome, found.verdict) == ("failed", "worse")
    assert "timestep=0.008 is not feasible any more; now recommends cone=" in found.message
    assert found.message.endswith("timestep=0.004")


@pytest.mark.long
def test_nothing_is_feasible_any_more(weighed: Runs, stored: Stored) -> None:
    after = weighed()
    for index in range(8):
        after.measure(index, depth=3e-3)
    before, nothing = stored("before", weighed()), stored("after", after)
    assert checked(before, nothing).message.endswith("and nothing else is")
    back = checked(nothing, before)
    assert (back.outcome, back.verdict) == ("noted", "better")
    assert checked(nothing, stored("again", after)).verdict == "same"


@pytest.mark.parametrize(("factor", "verdict"), [(0.9, "same"), (0.5, "changed")])
def test_something_else_is_far_cheaper(
    weighed: Runs, stored: Stored, factor: float, verdict: str
) -> None:
    """A tenth is what two sessions differ by; a half is not."""
    after = weighed()
    # The smallest timestep is an eighth of the largest, which is the cheapest otherwise.
    for index in (0, 4):
        after.cost(index, factor * 1e-3 / 8)
    found = checked(stored("before", weighed()), stored("after", after))
    assert found.verdict == verdict
    if verdict == "changed":
        assert "timestep=0.001 takes 50 % less time than" in found.message


def test_a_store_that_weighs_nothing_recommends_nothing(
    baseline: Path, runs: Runs, stored: Stored
) -> None:
    message = "neither store recommends a configuration"
    assert checked(baseline, stored("again", runs())).message == message


def test_busy_machines_recommend_nothing_else(weighed: Runs, stored: Stored) -> None:
    """Times that a busy machine moves by a fifth up or down make another one 30 % cheaper.

    The median deviation is log 1.2 = .18, so two times move apart by 2 sqrt(2) 1.48 .18 = .77 in 95
    of 100 cases, which is a saving of 53 %.
    """
    busy = weighed()
    for index, factor in enumerate([1.2, 1 / 1.2, 1.2, 1.2, 1 / 1.2, 1.2, 0.35 / 1.2, 1 / 1.2]):
        busy.cost(index, factor * 1e-3)
    assert checked(stored("before", weighed()), stored("after", busy)).verdict == "same"
