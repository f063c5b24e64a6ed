"""What is held neither deep inside the fingers nor, without adhesion, from one side alone."""

from pathlib import Path

import mujoco
import pytest

from contactlab.errors import SceneError
from contactlab.schema.task import QPOS0
from contactlab.studies.examine.design_causes import find_lost_grip
from contactlab.studies.grip.fingers import find_hand
from contactlab.studies.grip.grip_fact import find_grip
from contactlab.studies.grip.grip_verdict import MOST_DEPTH
from contactlab.studies.grip.gripping import GripRequest, judge_grip

# Jaws under position control that are told to close all the way, without a limit of force.
JAWS = """
<mujoco>
  <option timestep=".002"/>
  <worldbody>
    <body name="hand" pos="0 0 .3">
      <geom name="palm" type="box" size=".02 .06 .01" pos="0 0 .04" mass=".4"/>
      <body name="left" pos="0 .05 0"><joint name="left" type="slide" axis="0 -1 0" range="0 .05"
        damping="5"/><geom name="left" type="box" size=".01 .005 .03" mass=".05"/></body>
      <body name="right" pos="0 -.05 0"><joint name="right" type="slide" axis="0 1 0" range="0 .05"
        damping="5"/><geom name="right" type="box" size=".01 .005 .03" mass=".05"/></body>
    </body>
    <body name="box" pos="0 0 .285"><freejoint/>
      <geom name="box" type="box" size=".02 .02 .02" mass=".05"/></body>
  </worldbody>
  <actuator>
    <position name="left" joint="left" kp="{kp}" ctrlrange="0 .05"/>
    <position name="right" joint="right" kp="{kp}" ctrlrange="0 .05"/>
  </actuator>
  <keyframe><key name="closed" qpos=".0249 .0249 0 0 .285 1 0 0 0" ctrl=".05 .05"/></keyframe>
</mujoco>
"""
# A cup that sucks a box of 0.3 kg, or 2.9 N, from above.
CUP = """
<mujoco>
  <option timestep=".002" cone="elliptic" impratio="10"/>
  <worldbody>
    <body name="cup" pos="0 0 .58"><joint name="lift" type="slide" axis="0 0 1" range="-.3 .3"
      damping="50"/><geom name="cup" type="cylinder" size=".03 .01" mass="1" margin=".001"/></body>
    <body name="box" pos="0 0 .52"><freejoint/>
      <geom type="box" size=".05 .05 .05" mass=".3"/></body>
  </worldbody>
  <actuator>
    <position joint="lift" kp="5000" ctrlrange="-.3 .3"/>
    <adhesion name="suck" body="cup" ctrlrange="0 1" gain="{gain}"/>
  </actuator>
  <keyframe><key name="held" qpos="0 0 0 .52 1 0 0 0" ctrl="0 1"/></keyframe>
</mujoco>
"""


def judged(folder: Path, text: str, keyframe: str, *, fixes: bool = False):  # noqa: ANN201
    (folder / "model.xml").write_text(text)
    request = GripRequest(
        str(folder / "model.xml"), keyframe=keyframe, fixes=fixes, placements=False
    )
    return judge_grip(request)


@pytest.mark.long
def test_less_squeeze_is_part_of_each_fix_of_a_deep_grip(tmp_path: Path) -> None:
    report = judged(tmp_path, JAWS.format(kp=20000), "closed", fixes=True)
    assert report.depth_share > MOST_DEPTH
    assert report.verdict != "holds"
    assert report.fixes[0].verdict == "holds"
    assert all("times the squeeze" in fix.name for fix in report.fixes)
    fix = report.fixes[0]
    assert fix.options == {"noslip_iterations": 3}
    written = " ".join(f"{control}" for control in fix.keyframe_controls)
    assert any(f'ctrl="{written}"' in line for line in fix.lines)
    # The written keyframe holds in plain MuJoCo, with the fingers outside.
    text = JAWS.format(kp=20000).replace('ctrl=".05 .05"', f'ctrl="{written}"')
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.noslip_iterations = 3
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_step(model, data, 1000)
    assert abs(data.qpos[4] - 0.285) < 2e-4
    assert (data.qpos[:2] < 0.045 - 0.02 + 0.02 * MOST_DEPTH).all()


@pytest.mark.parametrize(("gain", "word"), [(20, "holds"), (2.5, "drops")])
def test_suction_holds_by_its_force(tmp_path: Path, gain: float, word: str) -> None:
    report = judged(tmp_path, CUP.format(gain=gain), "held")
    assert report.weight == pytest.approx(0.3 * 9.81)
    assert sum(finger.force for finger in report.fingers) == pytest.approx(gain, rel=0.01)
    # Friction of the cup is regularized, so that it may creep to the side.
    assert report.verdict in {"holds": ("holds", "creeps"), "drops": ("drops",)}[word]


def test_one_side_without_suction_holds_nothing(tmp_path: Path) -> None:
    text = CUP.format(gain=20).replace('ctrl="0 1"', 'ctrl="0 0"')
    with pytest.raises(SceneError):
        judged(tmp_path, text, "held")


# Two jaws that forces alone press on a box; nothing holds the pair of them from the side.
FORCED = """
<mujoco>
  <option timestep=".002" cone="elliptic" impratio="{impratio}"/>
  <worldbody>
    <body name="hand" pos="0 0 .4"><geom type="box" pos="0 0 .06" size=".05 .03 .01" mass=".5"/>
      <body name="left" pos="-.026 0 0"><joint name="left" type="slide" axis="1 0 0" damping="6"/>
        <geom type="box" size=".005 .012 .03" mass=".05"/></body>
      <body name="right" pos=".026 0 0"><joint name="right" type="slide" axis="-1 0 0" damping="6"/>
        <geom type="box" size=".005 .012 .03" mass=".05"/></body></body>
    <body name="box" pos="0 0 .4"><freejoint/>
      <geom type="box" size=".021 .02 .02" mass=".2"/></body>
  </worldbody>
  <actuator><motor joint="left"/><motor joint="right"/></actuator>
  <keyframe><key name="held" ctrl="12 12"/></keyframe>
</mujoco>
"""


def test_jaws_that_yield_to_a_load_with_their_object_hold_it(tmp_path: Path) -> None:
    """From the side, all three move at weight / damping of both jaws: 1.96 N / 12 Ns/m."""
    report = judged(tmp_path, FORCED.format(impratio=100), "held")
    limit = report.tolerance
    speeds = [drift.speed for drift in report.drifts]
    assert all(speed is not None and speed < limit < 1.96 / 12 for speed in speeds)
    assert report.verdict == "holds"


def test_a_held_object_may_creep_as_fast_as_one_at_rest(tmp_path: Path) -> None:
    """Regularized friction creeps by more than a grip may, and less than 3 % of a size a second."""
    report = judged(tmp_path, FORCED.format(impratio=10), "held")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    worst = max(drift.speed or 0.0 for drift in report.drifts)
    assert report.verdict == "creeps"
    assert report.tolerance < worst < 0.03 * 0.021
    assert list(find_lost_grip(model, report, report.sentence)) == []
    as_it_is, aside, *_ = report.drifts
    for drift, fails in ((as_it_is, True), (aside, False)):  # its weight is not from the side
        fast = drift.model_copy(update={"speed": 0.04 * 0.021})
        drifts = (fast, aside) if fails else (as_it_is, fast)
        faster = report.model_copy(update={"drifts": drifts})
        assert len(list(find_lost_grip(model, faster, report.sentence))) == fails


def test_a_part_that_is_pressed_into_the_world_is_no_hand(tmp_path: Path) -> None:
    wall = '<geom type="box" pos=".1 0 0" size=".02 .05 .05"/>'
    text = f"""<mujoco><worldbody>{wall}<body name="press"><joint name="x" type="slide"
      axis="1 0 0" range="-.1 .07"/><geom type="box" size=".01 .04 .04" mass="1"/></body>
      </worldbody><actuator><position joint="x" kp="500" kv="20" ctrlrange="-.1 .07"/></actuator>
      </mujoco>"""
    (tmp_path / "press.xml").write_text(text)
    model = mujoco.MjModel.from_xml_string(text)
    assert find_hand(model).base == 0
    assert find_grip(str(tmp_path / "press.xml"), model, QPOS0) is None
