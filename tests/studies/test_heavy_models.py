"""A model that takes longer than its CPU limit is judged by a shorter task and a first look."""

from collections.abc import Sequence
from pathlib import Path

import pytest
from tests.budget_motions import walker

from contactlab.budget import Motion, Settings
from contactlab.budget.counted_time import plan_budget
from contactlab.budget.measuring import count_evaluations, steps_of
from contactlab.modifications.catalogue import list_rows
from contactlab.plan.task_options import TaskOptions
from contactlab.schema.examination import Examination
from contactlab.studies.examine.examination import ExamineRequest, examine_model
from contactlab.tasks.session import Session

BALL = """<mujoco><worldbody><geom type="plane" size="1 1 .1"/>
  <body pos="0 0 .1"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""
STEP_SECONDS = 1e-3


def take_long(motions: Sequence[Motion]) -> float:
    """Return the counted time of a step [s] of a made-up model."""
    assert motions
    return STEP_SECONDS


def test_a_budget_is_measured_by_less_if_there_is_less_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each rung is taken exactly if it fits, and the one before does not."""
    monkeypatch.setattr("contactlab.budget.counted_time.count_pace", take_long)
    motions, whole = [walker()], Settings()
    steps = STEP_SECONDS * steps_of(motions)
    rows = [row for row in list_rows() if row.applies(motions[0].model)]
    judging = [row for row in rows if row.kind in ("numerics", "model")]
    for few, times in ((rows, 1), (judging, 2), ([], 2)):
        cost = count_evaluations(motions[0].model, whole, few) * steps / times
        names = tuple(row.name for row in few)
        assert plan_budget(motions, whole, 1.001 * cost) == (names, whole)
        assert len(plan_budget(motions, whole, 0.999 * cost)[0]) < max(1, len(names))
    names, settings = plan_budget(motions, whole, 0.999 * cost)
    assert (names, settings.check, settings.energy) == ((), False, False)


def examine(folder: Path, options: TaskOptions, max_cpu: float) -> Examination:
    (folder / "ball.xml").write_text(BALL)
    request = ExamineRequest(
        str(folder / "ball.xml"), task=options, sections=("labels",), max_cpu=max_cpu
    )
    return examine_model(request, Session(folder / "out", 0))


@pytest.mark.long
@pytest.mark.parametrize(
    ("max_cpu", "seeds", "shorter"), [(1e3, 3, False), (90.0, 2, False), (30.0, 1, True)]
)
def test_a_heavy_model_has_fewer_seeds_first(
    max_cpu: float, seeds: int, *, shorter: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Three seeds of 3 s at 2 ms make 4,500 steps, of 1 ms each: 135 s for thirty passes."""
    monkeypatch.setattr("contactlab.studies.examine.judged_model.count_pace", take_long)
    report = examine(tmp_path, TaskOptions(), max_cpu)
    assert len(report.task.seeds) == seeds
    assert (report.task.duration < 3.0) == shorter
    assert len(report.not_tried) == (seeds < 3) + shorter


@pytest.mark.long
def test_a_requested_task_is_kept_however_heavy_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("contactlab.studies.examine.judged_model.count_pace", take_long)
    whole = examine(tmp_path, TaskOptions(seeds=3, duration=0.5), 1.0)
    assert (len(whole.task.seeds), whole.task.duration) == (3, 0.5)
    assert whole.not_tried == ()
