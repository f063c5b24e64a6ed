"""The outcome of a sweep does not depend on who computes it, nor in what portions."""

import multiprocessing
from types import ModuleType
from typing import Any

import pytest

from contactlab.engines import ENGINES, Rollout
from contactlab.run import planned_runs, worker


@pytest.mark.parametrize("workers", [pytest.param(1, marks=pytest.mark.long), 2])
def test_workers_change_nothing(sweeper: Any, sweep_text: str, workers: int) -> None:
    sweeper.run(sweep_text, "here", workers=0)
    sweeper.run(sweep_text, "there", workers=workers)
    assert sweeper.outcome("there") == sweeper.outcome("here")
    assert multiprocessing.active_children() == []


@pytest.mark.night
def test_portions_change_nothing(
    sweeper: Any, sweep_text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    sweeper.run(sweep_text, "usual")
    usual = sweeper.outcome("usual")
    for most in (1, 3):
        monkeypatch.setattr(planned_runs, "MAX_RUNS", most)
        sweeper.run(sweep_text, f"by{most}")
        assert sweeper.outcome(f"by{most}") == usual


@pytest.mark.long
@pytest.mark.parametrize("bounded", [planned_runs, worker])
def test_the_memory_bound_changes_nothing(
    sweeper: Any, ball: str, monkeypatch: pytest.MonkeyPatch, bounded: ModuleType
) -> None:
    """Jobs are of one run each, or the worker makes theirs one by one."""
    sweeper.run(ball, "usual")
    monkeypatch.setattr(bounded, "JOB_BYTES", 1)
    alone: list[int] = []
    roll_out = type(ENGINES["mujoco"]).roll_out

    def counted(*given: Any) -> Rollout:
        rollout = roll_out(*given)
        alone.append(len(rollout.steps))
        return rollout

    monkeypatch.setattr(type(ENGINES["mujoco"]), "roll_out", counted)
    sweeper.run(ball, "one by one")
    assert alone == [1] * 18
    assert sweeper.outcome("one by one") == sweeper.outcome("usual")


OF_MANY_KINDS = """
version: 1
scene: box_slide
duration: 0.1
axes:
  integrator: [Euler, RK4, implicitfast, implicit]
  density: [0, 50]
  solimp.width: [1.0e-3, 2.0e-2]
"""


@pytest.mark.long
def test_no_run_depends_on_those_of_its_job(sweeper: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    sweeper.run(OF_MANY_KINDS, "usual")
    monkeypatch.setattr(planned_runs, "MAX_RUNS", 1)
    sweeper.run(OF_MANY_KINDS, "one by one")
    assert sweeper.outcome("one by one") == sweeper.outcome("usual")


def test_every_run_stands_once_and_in_plan_order(sweeper: Any, ball: str) -> None:
    manifest = sweeper.run(ball, workers=2)
    table, traces = sweeper.outcome()
    assert manifest.runs == len(table["run_id"]) == len(set(table["run_id"])) == len(traces) == 18
    assert table["index"] == list(range(18))
    assert table["seed"] == [0, 1, 2] * 6
