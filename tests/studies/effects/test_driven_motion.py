"""The motion that a drive makes is a result too, of every effect and of the written model."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from contactlab.plan.task_options import TaskOptions
from contactlab.studies.effects.effects_request import EffectsRequest
from contactlab.studies.effects.effects_study import study_effects
from contactlab.tasks.session import Session

# Gravity pulls both fingers along +y. The tendon holds their mean, the equality their difference.
GRIPPER = """<mujoco>
  <option gravity="0 9.81 0"/>
  <worldbody>
    <body pos="0 .1 0"><joint name="left" type="slide" axis="0 1 0" range="0 .04" damping="1"/>
      <geom type="box" size=".01 .01 .01" mass=".02" contype="0" conaffinity="0"/></body>
    <body pos="0 -.1 0"><joint name="right" type="slide" axis="0 -1 0" range="0 .04" damping="1"/>
      <geom type="box" size=".01 .01 .01" mass=".02" contype="0" conaffinity="0"/></body>
  </worldbody>
  <tendon><fixed name="split">
    <joint joint="left" coef=".5"/><joint joint="right" coef=".5"/></fixed></tendon>
  <equality><joint joint1="left" joint2="right" solref=".005 1"/></equality>
  <actuator><general name="grip" tendon="split" ctrlrange=".005 .035" gainprm="100"
    biastype="affine" biasprm="0 -100 -10"/></actuator>
  <keyframe><key qpos=".02 .02" ctrl=".02"/></keyframe>
</mujoco>"""


def driven(model: mujoco.MjModel) -> np.ndarray:
    """Return (n, 2) where the fingers are while the grip opens and closes, by MuJoCo alone."""
    data, path = mujoco.MjData(model), np.zeros((1000, 2))
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for row in path:
        data.ctrl[0] = 0.02 + 0.015 * np.sin(2 * np.pi * data.time)
        mujoco.mj_step(model, data)
        row[:] = data.qpos
    return path


@pytest.mark.long
def test_a_grip_that_a_tendon_transmits_is_needed_and_the_written_model_moves_alike(
    tmp_path: Path,
) -> None:
    (tmp_path / "gripper.xml").write_text(GRIPPER)
    task = TaskOptions(drive="exercise", duration=0.6)
    request = EffectsRequest(str(tmp_path / "gripper.xml"), task=task, write=tmp_path / "new/a.xml")
    report = study_effects(request, Session(tmp_path / "out"))
    found = {each.name: each for each in report.effects}
    assert found["grip"].verdict == found["equality"].verdict == "needed"
    # The tendon only transmits the force of the actuator, so that there is none to leave out.
    assert "split" not in found
    if report.smaller:
        old = mujoco.MjModel.from_xml_string(GRIPPER)
        new = mujoco.MjModel.from_xml_path(str(tmp_path / "new/a.xml"))
        # Without the equality, the fingers end 0.04 m apart, at their limits.
        assert np.abs(driven(new) - driven(old)).max() < 0.01 * 0.04
