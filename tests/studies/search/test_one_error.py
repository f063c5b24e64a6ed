"""The examination and tune have one numerical error of the model as written, and of a candidate."""

from dataclasses import replace
from pathlib import Path

import mujoco
import pytest

from contactlab.plan.task_options import TaskOptions, read_task_options
from contactlab.schema.error_budget import BudgetReport
from contactlab.studies.examine.examination import ExamineRequest
from contactlab.studies.examine.examination import examine_model as examine
from contactlab.studies.search.tune_request import TuneRequest
from contactlab.studies.search.tuning import tune_model
from contactlab.studies.search.tuning_problem import TuningProblem
from contactlab.tasks.checked_model import open_model
from contactlab.tasks.session import Session
from contactlab.tasks.time_limit import TimeLimit

BOX = """<mujoco><option timestep=".01"/><worldbody><geom type="plane" size="3 3 .1"/>
<body name="box" pos="0 0 .12" euler="20 10 0"><freejoint/>
<geom type="box" size=".05 .05 .05"/></body></worldbody></mujoco>"""
ARM = """<mujoco><option timestep=".008" integrator="implicitfast"/><worldbody>
<body name="arm" pos="0 0 1"><joint name="j" axis="0 1 0" damping=".1"/>
<geom type="capsule" size=".02" fromto="0 0 0 .3 0 0" contype="0" conaffinity="0"/></body>
</worldbody><actuator><motor joint="j" ctrlrange="-1 1"/></actuator></mujoco>"""
MODELS = {"box": BOX, "arm": ARM}


def write_model(name: str, folder: Path) -> str:
    path = folder / f"{name}.xml"
    path.write_text(MODELS[name])
    return str(path)


def budget_of(model: str, folder: Path, task: TaskOptions) -> BudgetReport:
    """Return the budget that an examination prints."""
    request = ExamineRequest(model, task=task, sections=("budget",))
    report = examine(request, Session(folder / "examined"))
    assert report.budget
    return report.budget


def error_of(budget: BudgetReport) -> float:
    return max(phase.numerical_error.error or 0.0 for phase in budget.phases)


def open_problem(model: str, folder: Path, task: TaskOptions) -> TuningProblem:
    examined = open_model(model, Session(folder / "tuned"), task)
    return TuningProblem(TuneRequest(model, task=task), examined, 1, TimeLimit(60.0))


@pytest.mark.parametrize("name", MODELS)
def test_the_model_as_written_has_one_error(name: str, tmp_path: Path) -> None:
    task = read_task_options(duration="0.3s")
    model = write_model(name, tmp_path)
    budget = budget_of(model, tmp_path, task)
    problem = open_problem(model, tmp_path, task)
    assert problem.current_error.error == error_of(budget) > 0
    assert problem.judged.budget_verdict.word == budget.verdict
    # A candidate with the settings of the model is the model.
    step = float(problem.own_model.opt.timestep)
    assert problem.measure_error(problem.model, step) == problem.current_error
    # The search ranks by other errors, which agree about the model as written.
    found = problem.error_estimator(problem.reference, problem.motions).estimate_error(
        problem.model, problem.reference.substeps
    )
    assert found.error == pytest.approx(problem.current_error.error)


def test_seeds_that_disagree_about_the_tolerance_are_added_in_both(tmp_path: Path) -> None:
    task = read_task_options(duration="0.3s")
    model = write_model("box", tmp_path)
    shares = open_problem(model, tmp_path, task).current_error.shares
    assert min(shares) < max(shares)
    near = replace(task, tolerance=((min(shares) + max(shares)) / 2, "1"))
    budget = budget_of(model, tmp_path, near)
    problem = open_problem(model, tmp_path, near)
    assert {phase.seeds for phase in budget.phases} == {len(problem.judged.task.seeds)} != {3}
    assert problem.current_error.error == error_of(budget)


def test_a_candidate_that_changes_physics_has_the_error_of_that(tmp_path: Path) -> None:
    """Its own examination cannot know it: without friction, the box slides exactly."""
    problem = open_problem(
        write_model("box", tmp_path), tmp_path, read_task_options(duration="0.3s")
    )
    step = float(problem.own_model.opt.timestep)
    smooth = mujoco.MjModel.from_xml_string(BOX.replace("<geom ", '<geom condim="1" '))
    before = problem.current_error.error
    assert problem.measure_error(smooth, step).error > 2 * before


@pytest.mark.long
@pytest.mark.parametrize("name", MODELS)
def test_each_command_says_the_same_of_the_model_and_of_the_recommendation(
    name: str, tmp_path: Path
) -> None:
    task = read_task_options(duration="0.3s")
    model = write_model(name, tmp_path)
    folder = tmp_path / "tuned"
    report = tune_model(TuneRequest(model, task=task, max_cpu=30.0), Session(folder))
    budget = budget_of(model, tmp_path, task)
    own = [point for point in report.front if "as written" in point.marks]
    assert [point.candidate.error for point in own] == [error_of(budget)] == [report.current.error]
    for point in report.front:  # the mean over more seeds than those of the budget
        assert point.error_seeds >= len(report.task.seeds)
        assert point.error_low is not None
        assert point.error_high is not None
        assert point.error
        assert point.error_low <= point.error <= point.error_high
    assert report.current_verdict
    assert report.current_verdict.verdict == budget.verdict
    assert report.target.kind == "tolerance" or error_of(budget) <= budget.tolerance
    if report.file:
        written = budget_of(str(folder / report.file), tmp_path / "written", task)
        assert report.recommended
        assert error_of(written) == pytest.approx(report.recommended.error, rel=0.05)
