"""The motion that a drive makes is a result too, of every effect and of the written model."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.plan.task_options import TaskOptions
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_writer import write_model
from contactlab.schema.study_reports import RecordedEffectsReport
from contactlab.studies.effects import ablation
from contactlab.studies.effects.configuration_runs import ConfigurationRows
from contactlab.studies.effects.effect_toggles import MOTION, difference, judged_metrics
from contactlab.studies.effects.effects_request import EffectsRequest
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


def ablated(tmp_path: Path) -> RecordedEffectsReport:
    (tmp_path / "gripper.xml").write_text(GRIPPER)
    request = EffectsRequest(
        str(tmp_path / "gripper.xml"), seeds=2, rounds=None, task=TaskOptions(drive="exercise")
    )
    return ablation.find_smallest_set(request, Session(tmp_path / "out"))


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
def test_what_carries_the_drive_is_kept_and_the_written_model_moves_alike(tmp_path: Path) -> None:
    report = ablated(tmp_path)
    assert {each.effect for each in report.effects if each.verdict == "needed"} >= {
        "actuation",
        "equality",
    }
    # It only transmits what the actuator does: there is nothing of its own to leave out.
    assert "tendon" not in {*report.smallest_set.off, *(each.effect for each in report.effects)}
    assert report.verification.holds
    assert report.verification.holds_as_written
    old = mujoco.MjModel.from_xml_string(GRIPPER)
    new = mujoco.MjModel.from_xml_path(str(tmp_path / "out/written-model/gripper.xml"))
    assert new.opt.disableflags != old.opt.disableflags
    # Without the equality, the fingers end 0.04 m apart, at their limits.
    assert np.abs(driven(new) - driven(old)).max() < 0.01 * 0.04


@pytest.mark.long
def test_a_written_model_that_moves_otherwise_does_not_hold(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wrong = ModelEdits({"actuation": False})
    monkeypatch.setattr(
        ablation, "write_model", lambda scene, _, folder: write_model(scene, wrong, folder)
    )
    report = ablated(tmp_path)
    assert report.verification.holds_as_written is False
    assert not report.verification.holds
    assert report.verification.reason.startswith("as text, ")


@given(
    seeds=st.lists(st.floats(-1, 1), min_size=2, max_size=6),
    shift=st.floats(-1, 1),
    drive=st.sampled_from([None, '"hold"', '"exercise"', '{"noise": 0.3, "rate": 10.0}']),
)
def test_motion_matters_beyond_tolerance_and_the_spread_over_seeds(
    seeds: list[float], shift: float, drive: str | None
) -> None:
    """One coordinate is moved at one time; the largest distance of any two seeds is the spread.

    Seeds that draw the controls have none.
    """
    own = [np.full((5, 2), seed) for seed in seeds]
    new = [each.copy() for each in own]
    for each in new:
        each[3, 1] += shift
    nothing = dict.fromkeys(judged_metrics()) | {"label": "stable", "drive": drive}
    base, other = (
        ConfigurationRows([{}], [[{**nothing, MOTION: each} for each in motions]])
        for motions in (own, new)
    )
    limit = 0.01 if drive and drive != '"hold"' else max(0.01, max(seeds) - min(seeds))
    if abs(abs(shift) - limit) > 1e-12:
        assert difference({}, base, other).is_significant == (abs(shift) > limit)
