"""Recommended fixes passed their verification; a fix that hides a fault is not recommended."""

from pathlib import Path

import pytest
from tests.studies.verification.planted import ARM, PINCH

from contactlab.schema.examination import Examination
from contactlab.studies.examine.examination import ExamineRequest, examine_model
from contactlab.studies.grip.gripping import GripRequest
from contactlab.studies.verification.verified_grip import judge_verified_grip
from contactlab.tasks.session import Session

BULLET = """
<mujoco>
  <option timestep="0.004"/>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1"/>
    <geom name="plate" type="box" size=".3 .3 .002" pos="0 0 .5"/>
    <body name="ball" pos="0 0 1.3">
      <freejoint/>
      <geom name="ball" type="sphere" size=".01" mass=".05"/>
    </body>
  </worldbody>
  <keyframe><key name="shot" qpos="0 0 1.3 1 0 0 0" qvel="0 0 -8 0 0 0"/></keyframe>
</mujoco>
"""
"""A ball of 8 m/s passes a plate of 4 mm, and most finer steps let it pass too."""
JAWS = PINCH.replace(' impratio="10" cone="elliptic" noslip_iterations="3"', "")


def _examine(folder: Path, text: str) -> Examination:
    file = folder / "model.xml"
    file.write_text(text)
    return examine_model(
        ExamineRequest(str(file), sections=("labels", "fixes")), Session(folder / "results")
    )


def _write_jaws(folder: Path, text: str) -> GripRequest:
    (folder / "jaws.xml").write_text(text)
    return GripRequest(str(folder / "jaws.xml"), keyframe="closed")


@pytest.mark.long
def test_a_short_keyframe_has_no_other_fix(tmp_path: Path) -> None:
    key = '<keyframe><key name="home" qpos="0.3"/></keyframe></mujoco>'
    report = _examine(tmp_path, ARM.replace("</mujoco>", key))
    assert report.fix.startswith("write 2 numbers in qpos of keyframe home (model.xml:")
    assert not report.fixes
    assert not report.written


@pytest.mark.night
def test_no_fix_leaves_the_ball_behind_the_plate(tmp_path: Path) -> None:
    report = _examine(tmp_path, BULLET)
    assert {"tunneling"} <= {label.label for label in report.labels}
    first = report.fixes[0]
    assert first.verification is not None
    assert first.verification.passed
    left = [each for each in first.verification.measures if each.name == "label tunneling"]
    assert not any(measure.after for measure in left)


@pytest.mark.long
def test_fingers_inside_the_object_get_no_fix_of_friction(tmp_path: Path) -> None:
    servo = 'kp="2000" ctrlrange="0 .05" forcerange="-5 5"'
    stiff = JAWS.replace(servo, 'kp="20000" ctrlrange="0 .05"')
    report = judge_verified_grip(_write_jaws(tmp_path, stiff))
    assert report.depth_share > 0.5
    friction = ("friction", "condim", "cone", "impratio")
    recommended = [fix for fix in report.fixes if fix.verdict == "holds" and fix.lines]
    assert not any(word in line for fix in recommended for line in fix.lines for word in friction)
    assert "Fix: 0.25 times the squeeze" in report.sentence
