"""The headline names the first cause, and the rest is judged from the repaired model."""

from pathlib import Path

import mujoco
import pytest

from contactlab.advisories.advisory_files import list_advisories
from contactlab.plan.task_options import read_task_options
from contactlab.schema.examination import Examination
from contactlab.studies.examine.examination import ExamineRequest, examine_model
from contactlab.tasks.session import Session

CHUTE = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="3 3 .1" contype="1" conaffinity="0"/>
  <body name="part" pos="0 0 .3"><freejoint/>
    <geom type="box" size=".05 .05 .05" mass=".5" contype="2" conaffinity="2"/></body>
  </worldbody></mujoco>"""


def examine(text: str, folder: Path, seconds: float = 1.0) -> Examination:
    file = folder / "model.xml"
    file.write_text(text, encoding="utf-8")
    options = read_task_options(drive="none", duration=f"{seconds}s")
    return examine_model(ExamineRequest(str(file), task=options), Session(folder / "out", 0))


@pytest.mark.long
def test_a_fault_of_the_engine_comes_first_and_its_workaround_is_verified(tmp_path: Path) -> None:
    """The released witness: plain MuJoCo runs it with another jacobian as earlier releases did."""
    advisory = next(each for each in list_advisories() if each.id == "CL-2026-0001")
    if not advisory.affects_release(mujoco.__version__):
        pytest.skip("this release is not affected")
    report = examine(advisory.witness.model, tmp_path)
    first, fix = report.causes[0], report.fixes[0]
    assert first.stage == "engine"
    assert advisory.id in report.headline
    assert fix.settings == {"jacobian": "dense"}
    assert fix.verification is not None
    assert fix.verification.passed


@pytest.mark.long
def test_contacts_that_masks_forbid_come_before_all_others(tmp_path: Path) -> None:
    report = examine(CHUTE, tmp_path)
    assert report.verdict == "fails"
    assert report.headline == "fails: part falls through floor"
    assert report.fixes[0].opened_geoms == (("floor", "conaffinity", 2),)
    model = mujoco.MjModel.from_xml_string(
        CHUTE.replace('contype="1" conaffinity="0"', 'contype="1" conaffinity="2"')
    )
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 500)
    assert data.qpos[2] == pytest.approx(0.05, abs=1e-3)


WHEEL = """<mujoco><option timestep=".005" integrator="Euler"/><worldbody>
  <body><joint name="axle" axis="0 1 0" damping=".001"/>
    <geom type="cylinder" size=".04 .01" euler="90 0 0" mass=".1"/></body></worldbody>
  <actuator>{servo}</actuator><keyframe><key name="cruise" ctrl="5"/></keyframe></mujoco>"""


@pytest.mark.long
@pytest.mark.parametrize(
    ("servo", "words"),
    [
        ('<velocity joint="axle" kv=".08"/>', "does not hold joint 'axle'"),
        (
            '<general joint="axle" dyntype="filter" dynprm=".001" gainprm=".01"/>',
            "is too long for the activation of actuator[0]",
        ),
    ],
)
def test_a_gain_or_an_activation_that_the_step_does_not_hold_is_the_cause(
    servo: str, words: str, tmp_path: Path
) -> None:
    """Its edit alone, in plain MuJoCo, ends the growth: the inertia is 8e-5 kg m^2."""
    report = examine(WHEEL.format(servo=servo), tmp_path)
    cause, fix = report.causes[0], report.fixes[0]
    assert (report.verdict, cause.stage, cause.verdict) == ("inaccurate", "numerics", "ok")
    assert words in report.headline
    assert not fix.changes_model
    old, new = tmp_path / "model.xml", fix.lines[0].partition(": ")[2]
    tag = new.partition(" ")[0]
    begin = old.read_text(encoding="utf-8").index(tag)
    text = old.read_text(encoding="utf-8")
    end = text.index("/>", begin) + 2
    fixed = text[:begin] + new + text[end:]
    assert [is_stable(each) for each in (text, fixed)] == [False, True]


def is_stable(text: str) -> bool:
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.ctrl[:] = 5
    mujoco.mj_step(model, data, 200)
    return not data.warning.number.any()
