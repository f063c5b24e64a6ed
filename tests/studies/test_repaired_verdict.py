"""The verdict that a fix promises is that of the written model, all faults of its file included."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import pytest

import contactlab
from contactlab.budget import Verdict
from contactlab.commands.examine import examine
from contactlab.errors import ExpectationError, OutputError
from contactlab.modifications.modification import NO_EDITS
from contactlab.scene.scene_source import find_scene
from contactlab.schema.examination import Examination
from contactlab.schema.task import QPOS0
from contactlab.studies.examine.linted_file import FileFault, lint_file
from contactlab.studies.examine.repaired_causes import Repair, RepairedModel, is_better

DOUBLED = """<mujoco><worldbody><geom type="plane" size="1 1 .1"/>
  <body pos="0 0 .1"><freejoint/><geom name="one" size=".1"/><geom name="two" size=".1"/>
    <body pos=".2 0 0"><joint name="hip" axis="0 1 0" {motor}/><geom size=".03" pos=".1 0 0"/>
  </body></body></worldbody>{key}</mujoco>"""
ARM = """<mujoco><worldbody><body pos="0 0 1">
  <joint name="hip" axis="0 1 0" actuatorfrcrange="-5 5"/><geom size=".03" pos=".1 0 0"/>
  </body></worldbody><keyframe><key name="home" qpos=".5"/></keyframe></mujoco>"""
WHEEL = """<mujoco><option timestep=".002"/><worldbody><body>
  <joint name="turn" axis="0 0 1" damping=".005"/><geom size=".1" mass=".005"/></body></worldbody>
<actuator><velocity joint="turn" kv=".05" ctrlrange="-1 1" forcerange="-.0043 .0043"/></actuator>
</mujoco>"""
"""Half the step halves the error of the run, which its weak motor limits, but at 1 ms any motion
grows 1.2-fold."""
FAULT = FileFault("no-actuators", "no actuators: the robot hangs limp; add one")
LIMP = """<robot name="limp">
  <link name="base"><inertial><mass value="2"/>
    <inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="leg"><inertial><origin xyz="0 0 -.1"/><mass value=".5"/>
    <inertia ixx=".001" iyy=".001" izz=".001" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="hip" type="revolute"><parent link="base"/><child link="leg"/>
    <axis xyz="0 1 0"/><limit lower=".5" upper="1" effort="{effort}" velocity="5"/></joint>
</robot>"""


def test_a_fault_that_is_left_fails_whatever_the_runs_say() -> None:
    examined: Any = SimpleNamespace(budget_verdict=Verdict("ok", 0.1, ()))
    assert RepairedModel(examined, ()).word == "ok"
    assert RepairedModel(examined, (), faults=(FAULT,)).word == "fails"
    assert RepairedModel(examined, (), failed_checks=("impossible_bodies",)).word == "fails"


def test_a_repair_of_another_rule_or_of_the_start_repairs_no_fault_of_the_file() -> None:
    start = Repair("start", "its start overlaps", "a raised start", "raise", NO_EDITS)
    other = Repair("file", "two geoms", "no contacts", "single", NO_EDITS, rule="coincident-geoms")
    assert not start.repairs_fault(FAULT)
    assert not other.repairs_fault(FAULT)
    assert other._replace(rule=FAULT.rule).repairs_fault(FAULT)


def test_an_edit_of_the_file_that_ends_all_complaints_counts_whatever_they_hid() -> None:
    """An object inside its jaws does not creep; one that they hold does."""
    sunk: Any = SimpleNamespace(budget_verdict=Verdict("inaccurate", 0.2, ()))
    held: Any = SimpleNamespace(budget_verdict=Verdict("ok", 0.01, ()))
    names = ("tunneling", "creep")
    tunneling, creep = (SimpleNamespace(label=name) for name in names)
    labels: Any = {"before": (tunneling,), "after": (creep,), "both": (creep, tunneling)}
    before = RepairedModel(sunk, labels["before"])
    edit = Repair("file", "jaws press", "an edit", "jaw-force", NO_EDITS)
    assert is_better(before, RepairedModel(held, labels["after"]), edit)
    assert not is_better(
        RepairedModel(held, labels["before"]), RepairedModel(held, labels["both"]), edit
    )


@pytest.mark.long
def test_no_fix_leaves_a_joint_that_the_step_does_not_hold(tmp_path: Path) -> None:
    path = tmp_path / "wheel.xml"
    path.write_text(WHEEL)
    report = contactlab.examine(
        path, output=tmp_path / "one.json", duration="0.6s", workers=0, seeds=1
    )
    assert report.fixes
    (half,) = (one for one in report.rejected_fixes if one.name == "half the step")
    assert half.reason.startswith("it leaves: a step of 1 ms with Euler does not hold joint 'turn'")
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.timestep = 0.001
    assert measure_growth(model) == pytest.approx(1.2, rel=0.02)
    (numerical,) = (one for one in report.fixes if not one.changes_model)
    assert numerical.settings == {"integrator": "implicitfast"}
    model.opt.timestep, model.opt.integrator = 0.002, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    assert measure_growth(model) < 1


def measure_growth(model: mujoco.MjModel) -> float:
    """Return the factor that one step changes a small speed by."""
    data, speed = mujoco.MjData(model), 1e-9
    data.qvel[0] = speed
    mujoco.mj_step(model, data)
    return abs(float(data.qvel[0])) / speed


@pytest.mark.long
@pytest.mark.parametrize("motor", ["", 'actuatorfrcrange="-5 5"'])
def test_the_promised_verdict_is_that_of_the_written_model(motor: str, tmp_path: Path) -> None:
    path, fixed = tmp_path / "robot.xml", tmp_path / "fixed" / "robot.xml"
    key = '<keyframe><key qpos="0 0 .1 1 0 0 0 0"/></keyframe>' if motor else ""
    path.write_text(DOUBLED.format(motor=motor, key=key))
    task: Any = {"duration": "0.6s", "workers": 0, "seeds": 1}
    report = contactlab.examine(
        path, output=tmp_path / "one.json", write=fixed, apply=["single"], **task
    )
    promised = next(cause for cause in report.causes if cause.repair)
    again = contactlab.examine(fixed, output=tmp_path / "two.json", **task)
    assert promised.verdict == again.verdict
    assert (again.verdict == "fails") == bool(motor)


@pytest.mark.long
@pytest.mark.parametrize("effort", [0, 10])
def test_a_urdf_that_nothing_drives_is_judged_as_it_falls(effort: int, tmp_path: Path) -> None:
    path = tmp_path / "limp.urdf"
    path.write_text(LIMP.format(effort=effort).replace('lower=".5"', 'lower="-1"'))
    report = contactlab.examine(path, output=tmp_path / "a.json", duration="0.6s", workers=0)
    assert report.verdict == "ok"
    assert report.why[0].startswith("no actuators: 1 joint") == bool(effort)


@pytest.mark.parametrize("start", [QPOS0, "home"])
def test_missing_actuators_void_the_posture_of_a_keyframe_alone(start: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(ARM)
    file = lint_file(find_scene(str(path)), str(path), start)
    limp = [fact for fact in file.facts if fact.kind == "limp"]
    assert [fault.rule for fault in file.faults if fault.is_certain] == (
        [] if start == QPOS0 else ["no-actuators"]
    )
    assert bool(limp) == (start == QPOS0)


def test_a_requested_fix_that_is_not_written_ends_with_2() -> None:
    failure_of = examine.__dict__["command"].failure
    report = Examination.model_construct(
        verdict="fails", model="a.xml", not_written="--apply x: no"
    )
    assert isinstance(failure_of(report, {}), OutputError)
    plain = report.model_copy(update={"not_written": ""})
    assert isinstance(failure_of(plain, {}), ExpectationError)
    assert failure_of(plain.model_copy(update={"verdict": "ok"}), {}) is None


# Two jaws that are driven closed without a limit of force, and a box between them.
_PRESS = """<mujoco><option timestep=".002"{noslip}/><worldbody><body name="hand" pos="0 0 .3">
<geom type="box" size=".02 .06 .01" pos="0 0 .05" mass=".4"/>
<body name="a" pos="0 .05 0"><joint name="a" type="slide" axis="0 -1 0" range="0 .05" damping="5"/>
<geom type="box" size=".01 .005 .03" mass=".05"/></body>
<body name="b" pos="0 -.05 0"><joint name="b" type="slide" axis="0 1 0" range="0 .05" damping="5"/>
<geom type="box" size=".01 .005 .03" mass=".05"/></body></body>
<body name="box" pos="0 0 .29"><freejoint/><geom type="box" size=".02 .02 .02" mass=".05"/></body>
</worldbody><actuator>
<position name="a" joint="a" kp="18000" ctrlrange="0 .05"{force}/>
<position name="b" joint="b" kp="18000" ctrlrange="0 .05"{force}/></actuator>
<keyframe><key name="closed" qpos=".0249 .0249 0 0 .29 1 0 0 0" ctrl=".05 .05"/></keyframe>
</mujoco>"""


def drop_box(xml: str) -> float:
    """Return how far the box of a held keyframe sinks in 8 s [m]."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    while data.time < 8:
        mujoco.mj_step(model, data)
    return 0.29 - float(data.body("box").xpos[2])


@pytest.mark.night
def test_a_jaw_without_a_limit_of_force_is_the_cause_of_the_creep_that_it_hides(
    tmp_path: Path,
) -> None:
    """The box creeps out of the jaws; with a limit of force and noslip, both of lint, it stays.

    The limit makes free jaws follow a step less well, so nothing is written without the author.
    """
    path = tmp_path / "press.xml"
    path.write_text(_PRESS.format(noslip="", force=""))
    report = contactlab.examine(path, output=tmp_path / "one.json", workers=0)
    assert report.headline == "inaccurate: servo a of a jaw has no force range"
    assert report.fix.startswith("by hand: write a forcerange")
    (joined,) = (one for one in report.rejected_fixes if ", with noslip" in one.name)
    assert "tracking error" in joined.reason
    assert drop_box(_PRESS.format(noslip="", force="")) > 1e-2
    fixed = _PRESS.format(noslip=' noslip_iterations="3"', force=' forcerange="-7.5 7.5"')
    assert drop_box(fixed) < 1e-3
