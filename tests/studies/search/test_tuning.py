"""From a model to the settings to use: models with planted waste and planted needs."""

from pathlib import Path
from typing import Any

import mujoco
import pytest
from tests.noisy_clock import disturb_clock
from tests.studies.verification.planted import BARE_JAWS

from contactlab.errors import ExpectationError, SweepFileError
from contactlab.plan.task_options import TaskOptions, read_task_options
from contactlab.schema.tune_report import TuneReport
from contactlab.studies.search.search_chart import draw_front
from contactlab.studies.search.tuning import TuneRequest, tune_model
from contactlab.studies.search.tuning_problem import TuningProblem
from contactlab.studies.verification.grip_measures import compare_grips
from contactlab.tasks.checked_model import open_model
from contactlab.tasks.session import Session
from contactlab.tasks.time_limit import TimeLimit

PLANTED = Path(__file__).parent / "planted"
PENDULUM = """<mujoco>
  <!-- a comment stays -->
  <option timestep="0.001" integrator="RK4"><flag energy="enable"/></option>
  <worldbody>
    <body name="arm" pos="0 0 1">
      <joint name="hinge" axis="0 1 0" damping="0.05"/>
      <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
</mujoco>
"""
DOUBLE = PENDULUM.replace(
    "</body>\n  </worldbody>",
    '<body pos=".3 0 0"><joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .3 0 0" '
    'size=".02" contype="0" conaffinity="0"/></body></body>\n  </worldbody>',
).replace(' damping="0.05"', "")
SHORT = read_task_options(drive="none", duration="0.4s")


def tuned(text: str, folder: Path, **asked: Any) -> TuneReport:
    path = folder / "robot.xml"
    path.write_text(text)
    options: dict[str, Any] = {"task": SHORT, "max_cpu": 60.0, **asked}
    return tune_model(TuneRequest(str(path), **options), Session(folder / "out"))


def changes_of(report: TuneReport) -> dict[str, Any]:
    return {each.name: each.after for each in report.changed_settings}


@pytest.mark.long
def test_needless_steps_go_and_lines_that_save_nothing_stay(tmp_path: Path) -> None:
    report = tuned(PENDULUM, tmp_path)
    assert report.target_met
    assert report.recommended
    assert report.recommended.time_ratio
    assert report.recommended.time_ratio.high < 0.5
    # The energy of one body is less than 3 % of a step.
    assert not report.recommended.removes_unused
    assert report.verified
    assert report.verified.holds
    assert report.verified.verdict == "ok"
    assert report.file
    path = tmp_path / "out" / report.file
    assert "<!-- a comment stays -->" in path.read_text()
    made = mujoco.MjModel.from_xml_path(str(path))
    # Text, patch and data say the same settings.
    assert made.opt.timestep == report.recommended.timestep == changes_of(report)["timestep"]
    assert made.opt.enableflags & int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    marks = [mark for point in report.front for mark in point.marks]
    assert sorted(marks) == ["as written", "recommended"]
    assert 2 <= len(report.front) <= 8
    errors = [point.error or 0.0 for point in report.front]
    assert errors == sorted(errors)
    drawn = str(draw_front(report).to_dict())
    assert all(f"{point.number} {point.name}" in drawn for point in report.front)


@pytest.mark.long
def test_a_gripper_keeps_its_contacts_without_an_object(tmp_path: Path) -> None:
    """Without its pads' contacts its motion is the same, bit for bit, but it holds nothing."""
    (tmp_path / "jaws.xml").write_text(BARE_JAWS)
    request = TuneRequest(str(tmp_path / "jaws.xml"), task=SHORT, max_cpu=60.0)
    examined = open_model(request.model, Session(tmp_path / "out"), SHORT)
    problem = TuningProblem(request, examined, 1, TimeLimit(60.0))
    assert problem.unused.masked == ()
    assert problem.unused.excluded == (("left", "right"),)
    (tmp_path / "off.xml").write_text(
        BARE_JAWS.replace("<worldbody>", '<option><flag contact="disable"/></option><worldbody>')
    )
    changed = open_model(str(tmp_path / "off.xml"), Session(tmp_path / "off"), SHORT)
    measures = list(compare_grips(examined, changed, problem.original_runs.grips))
    assert {each.name for each in measures if each.worse} == {"grip creep", "pull-out force"}


@pytest.mark.long
def test_a_forward_error_is_kept_where_the_motion_is_regular(tmp_path: Path) -> None:
    """RK4's error at the end is fourth order: 1e-6 m leaves several times the step."""
    asked: dict[str, Any] = {"observed": ("arm",), "error_at": "end", "error": 1e-6}
    text = PENDULUM.replace('name="arm" ', "").replace(
        "    </body>", '<site name="arm" pos=".3 0 0"/></body>'
    )
    report = tuned(text, tmp_path, **asked)
    assert report.target.divergence.startswith("regular")
    assert report.recommended
    assert report.recommended.error is not None
    assert report.recommended.error <= 1e-6
    assert report.recommended.timestep >= 4e-3
    assert report.verified
    assert report.verified.error is not None
    assert report.verified.error <= 1e-6


@pytest.mark.long
def test_of_a_chaotic_motion_no_forward_error_is_promised(tmp_path: Path) -> None:
    asked: dict[str, Any] = {"observed": ("arm",), "error_at": "peak", "error": 1e-5}
    text = DOUBLE.replace('pos="0 0 1"', 'pos="0 0 1" euler="0 170 0"')
    task = read_task_options(drive="none", duration="12s")
    with pytest.raises(ExpectationError, match="chaotic: a nudge grows"):
        tuned(text, tmp_path, task=task, **asked)


TUMBLING = """<mujoco>
  <option timestep="0.008" solver="PGS" iterations="400" tolerance="1e-15"/>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 .1" friction=".3"/>
    <geom name="shelf" type="box" size=".2 .2 .02" pos="2 0 .5"/>
    <body name="box" pos="0 0 .15" euler="25 0 0"><freejoint/>
      <geom name="box" type="box" size=".1 .1 .1"/></body>
  </worldbody>
</mujoco>
"""


@pytest.mark.long
def test_a_coarser_step_is_recommended_only_on_request(tmp_path: Path) -> None:
    """An impact at 8 ms has an error; by default it may not grow, and --error allows it to."""
    task = read_task_options(drive="none", duration="0.5s")
    asked: dict[str, Any] = {"task": task, "apply": {"far-pairs": 0.05}}
    (tmp_path / "default").mkdir()
    report = tuned(TUMBLING, tmp_path / "default", **asked)
    assert report.current.error
    assert report.target.limit == report.current.error
    assert report.recommended
    assert report.recommended.error
    assert report.recommended.error <= 1.02 * report.current.error
    assert report.recommended.cost
    assert report.recommended.cost < 0.8
    assert report.verified
    assert report.verified.panel
    assert report.verified.panel.passed
    # The shelf, which nothing came near, is left out.
    assert report.far_pairs
    assert report.far_pairs.removed
    assert report.far_pairs.geoms == ("shelf",)
    assert report.file
    made = mujoco.MjModel.from_xml_path(str(tmp_path / "default" / "out" / report.file))
    assert made.opt.timestep == report.recommended.timestep
    assert made.opt.solver == mujoco.mjtSolver.mjSOL_NEWTON
    assert made.geom("shelf").contype[0] == made.geom("shelf").conaffinity[0] == 0
    assert "recommended" in {mark for point in report.front for mark in point.marks}


@pytest.mark.long
def test_a_slow_and_noisy_machine_gets_the_same_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All clocks run at rates that change at random, and one worker does the work of two."""
    found = list[dict[str, bytes]]()
    for seed in range(2):
        folder = tmp_path / str(seed)
        folder.mkdir()
        if seed:
            for name in ("monotonic", "thread_time", "process_time"):
                disturb_clock(monkeypatch, name, seed, 1.0, 20.0)
        path = folder / "robot.xml"
        path.write_text(TUMBLING)
        request = TuneRequest(str(path), task=SHORT, max_cpu=3600.0)
        report = tune_model(request, Session(folder / "out", workers=2 - 2 * seed))
        files = sorted((folder / "out" / "tuned").rglob("*"))
        found.append({each.name: each.read_bytes() for each in files if each.is_file()})
        steady = report.model_dump_json(exclude=MEASURED)
        found[-1]["report"] = steady.replace(str(folder), "").encode()
    assert "tuned.xml" in found[0]
    assert found[0] == found[1]


MEASURED: Any = {
    "real_time": True,
    "seconds": True,
    "sentence": True,
    "current": {"time_ratio"},
    "recommended": {"time_ratio"},
    "candidates": {"__all__": {"time_ratio"}},
    "front": {"__all__": {"real_time": True, "candidate": {"time_ratio"}}},
}
"""Fields of a report that are measured times."""


@pytest.mark.night
@pytest.mark.parametrize("need", ["slope", "top", "bottle"])
def test_what_a_model_needs_stays(need: str, tmp_path: Path) -> None:
    """A slope creeps without noslip; a top spins on torsion; a bottle stands on many contacts."""
    text = (PLANTED / f"{need}.xml").read_text(encoding="utf-8")
    report = tuned(text, tmp_path, task=read_task_options(drive="none", duration="0.6s"))
    after = changes_of(report)
    assert "noslip_iterations" not in after or after["noslip_iterations"] > 0
    assert not any(name.startswith("geom_condim") for name in after)
    assert "multiccd" not in after


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (
            {"task": TaskOptions(limits={"slip": 1e-3})},
            "--tolerance slip=: tune uses the error budget",
        ),
        ({"real_time": 5.0, "error": 0.1}, "--real-time minimizes the error"),
        ({"error_at": "end"}, "--error-at needs --observe"),
        ({"error_at": "end", "observed": ("arm",)}, "--error-at needs a target"),
        ({"error": 3.0}, "--error 3 is not a fraction"),
    ],
)
def test_options_that_contradict_each_other_are_refused(
    asked: dict[str, Any], words: str, tmp_path: Path
) -> None:
    with pytest.raises(SweepFileError, match=words):
        tuned(PENDULUM, tmp_path, **asked)
    assert not (tmp_path / "out").exists()
