"""A study is planned in counted work, so that its answer does not depend on the machine's load."""

import math
from pathlib import Path

import pytest

from contactlab.schema.task import Phase, Task
from contactlab.studies.search.tune_request import TuneRequest
from contactlab.studies.search.tuning_problem import PLAN, TuningProblem
from contactlab.studies.verification.panel_cost import estimate_panel
from contactlab.tasks.checked_model import open_model
from contactlab.tasks.session import Session
from contactlab.tasks.task_motions import shorten_task
from contactlab.tasks.time_limit import TimeLimit

BALL = """<mujoco>
  <worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body pos="0 0 .1"><freejoint/><geom size=".05"/></body>
  </worldbody>
</mujoco>
"""
TASK = Task(
    start="qpos0",
    drive="exercise",
    own_controls=False,
    duration=3.0,
    phases=(Phase(name="rest", begin=0.0, end=1.0), Phase(name="excitation", begin=1.0, end=3.0)),
)


def _plan(folder: Path, seconds: float) -> TuningProblem:
    (folder / "ball.xml").write_text(BALL)
    request = TuneRequest(str(folder / "ball.xml"), max_cpu=seconds)
    checked = open_model(request.model, Session(folder / "out"))
    return TuningProblem(request, checked, 1, TimeLimit(seconds))


def test_a_shortened_task_has_the_first_share_of_each_phase() -> None:
    short = shorten_task(TASK, 0.25)
    assert [(phase.begin, phase.end) for phase in short.phases] == [(0.0, 0.25), (1.0, 1.5)]
    assert shorten_task(TASK, 1.0) == TASK


@pytest.mark.long
def test_little_work_shortens_verifications_and_much_does_not(tmp_path: Path) -> None:
    whole = _plan(tmp_path, 300.0)
    assert whole.length_share == whole.verified_share == 1
    assert whole.verified_seeds == whole.seeds == 3
    assert not whole.skipped
    short = _plan(tmp_path, 3.0)
    assert short.verified_share < 1
    assert short.verified_task == shorten_task(whole.verified_task, short.verified_share)
    assert short.verified_share <= short.length_share
    assert short.verified_seeds == 1
    assert {each.name for each in short.skipped} >= {"verification", "seeds"}
    for own, all_of_it in zip(short.motions, whole.motions, strict=True):
        assert own.steps == pytest.approx(short.length_share * all_of_it.steps, abs=1)


@pytest.mark.long
def test_the_first_verification_fits_into_the_work(tmp_path: Path) -> None:
    for seconds in (20.0, 60.0):
        plan = _plan(tmp_path, seconds)
        cost = estimate_panel(
            plan.own_model, TASK, plan.verified_seeds, plan.verified_share, plan.cost.step_seconds
        )
        assert cost.first <= PLAN.verification * PLAN.whole * seconds
        assert cost.next < cost.first


def test_a_slower_step_takes_more_time_in_proportion(tmp_path: Path) -> None:
    model = _plan(tmp_path, 30.0).own_model
    costs = [estimate_panel(model, TASK, 3, 1.0, step).first for step in (0.0, 1e-3, 2e-3)]
    assert math.isclose(costs[2] - costs[1], costs[1] - costs[0], rel_tol=1e-9)
