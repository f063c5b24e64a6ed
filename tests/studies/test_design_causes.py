"""Starts, links and servos that a keyframe contradicts, by closed forms."""

import math

import mujoco
import numpy as np
import pytest

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.studies.examine.design_causes import find_overrun_stop, find_sagging_servo
from contactlab.studies.examine.permanent_overlaps import find_permanent_overlaps
from contactlab.studies.examine.standing_starts import find_fall, list_standing_poses
from contactlab.studies.examine.undone_designs import TaskEnds

COVERED = """<mujoco><worldbody>
  <body name="arm"><joint axis="0 1 0"/><geom type="capsule" size=".03" fromto=".1 0 0 .35 0 0"/>
    <body name="hand" pos=".4 0 0"><joint axis="0 1 0"/>
      <geom type="capsule" size=".02" fromto=".1 0 0 .3 0 0"/>
      <body name="cover"><joint axis="0 1 0"/>
        <geom type="capsule" size=".05" fromto="{back} 0 0 .02 0 0"/></body></body></body>
  </worldbody></mujoco>"""

TABLE = """<mujoco><worldbody><geom type="plane" size="2 2 .1"/>
  <body name="top" pos="0 0 .3"><freejoint/><geom type="box" size=".3 .3 .02" pos="0 0 -.02"/>
    <geom size=".02" pos=".25 .25 -.28"/><geom size=".02" pos="-.25 .25 -.28"/>
    <geom size=".02" pos=".25 -.25 -.28"/><geom size=".02" pos="-.25 -.25 -.28"/>
    <body name="lamp"><joint name="lamp" axis="0 1 0" range="-90 90"/>
      <geom type="capsule" size=".01" fromto="0 0 .02 0 0 .06" mass="1"/></body></body>
  </worldbody>
  <actuator><position joint="lamp" kp="10" kv="1"/></actuator>
  <keyframe><key name="here" qpos="0 0 .3 {turn} {lamp}" ctrl="{aim}"/></keyframe></mujoco>"""

CRANE = """<mujoco><worldbody><body name="boom"><joint name="boom" axis="0 -1 0" damping="2"/>
    <geom type="sphere" size=".05" pos=".4 0 0" mass="1"/></body></worldbody>
  <actuator><position joint="boom" kp="{gain}" kv="4"/></actuator>
  <keyframe><key name="level" qpos="0" ctrl="{aim}"/></keyframe></mujoco>"""


def motion_of(text: str, seconds: float = 2.0) -> Motion:
    """Return the motion of a model from its first keyframe, or without one, under its controls."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    start = np.empty(mujoco.mj_stateSize(model, INTEGRATION))
    controls, data.ctrl[:] = data.ctrl.copy(), 0
    mujoco.mj_getState(model, data, start, INTEGRATION)
    steps = round(seconds / model.opt.timestep)
    return Motion(model, start[None], np.tile(controls, (1, steps, 1)))


@pytest.mark.parametrize(("back", "overlaps"), [(-0.1, True), (-0.02, True), (0.0, False)])
def test_links_overlap_for_ever_if_no_joint_parts_them(back: float, *, overlaps: bool) -> None:
    """The arm's round end lies .02 m from the axis that the cover's inner end surrounds by .05."""
    text = COVERED.format(back=back)
    if not overlaps:
        text = text.replace('size=".05"', 'size=".01"')
    found = find_permanent_overlaps(motion_of(text))
    assert [pair.names for pair in found] == [("arm", "cover")] * overlaps


def test_links_that_one_pose_parts_do_not_overlap_for_ever() -> None:
    """A cover beyond the arm's end reaches it only if it points back."""
    text = COVERED.format(back=-0.2).replace(".02 0 0", "-.08 0 0").replace('".05"', '".02"')
    motion = motion_of(text)
    data = mujoco.MjData(motion.model)
    mujoco.mj_forward(motion.model, data)
    assert data.ncon
    assert find_permanent_overlaps(motion) == []


def test_a_table_on_its_back_stands_if_its_root_is_turned() -> None:
    upright = motion_of(TABLE.format(turn="1 0 0 0", lamp=0, aim=0))
    overturned = motion_of(TABLE.format(turn="0 1 0 0", lamp=0, aim=0))
    assert find_fall(upright) == 0
    assert find_fall(overturned) > 0.15
    (pose,) = list_standing_poses(overturned)
    assert pose.positions[3:7] == pytest.approx([1, 0, 0, 0])
    assert find_fall(overturned, pose.positions) == 0


@pytest.mark.parametrize(("aim", "held"), [(0.5, 0.5), (3.0, math.pi / 2)])
def test_joints_are_held_where_their_controls_are_within_their_range(
    aim: float, held: float
) -> None:
    (pose,) = list_standing_poses(motion_of(TABLE.format(turn="1 0 0 0", lamp=0.1, aim=aim)))
    assert pose.positions[-1] == pytest.approx(held)


@pytest.mark.parametrize(("gain", "sags"), [(6.0, True), (60.0, False)])
def test_a_servo_sags_by_the_torque_of_its_load_over_its_gain(gain: float, *, sags: bool) -> None:
    """At rest, k q = m g l cos(q); a twentieth of a turn is 18 degrees."""
    found = list(find_sagging_servo(TaskEnds(motion_of(CRANE.format(gain=gain, aim=0), 8.0))))
    assert len(found) == sags
    angle = 0.0
    for _ in range(200):
        angle += 0.1 * (9.81 * 0.4 * math.cos(angle) / gain - angle)
    for cause in found:
        assert f"boom sags by {math.degrees(angle):.0f} deg" in cause.sentence


def test_a_control_that_allows_for_its_load_is_no_sag() -> None:
    """It aims above the level at which the load holds it."""
    aim = 9.81 * 0.4 / 6
    assert list(find_sagging_servo(TaskEnds(motion_of(CRANE.format(gain=6, aim=aim), 8.0)))) == []


RAIL = """<mujoco><option gravity="0 0 0"/><worldbody><body name="car">
    <joint name="rail" type="slide" axis="1 0 0" range="0 1" damping="10"
      solreflimit="-500 -50"/>
    <geom size=".05" mass="1"/></body></worldbody>
  <actuator><position joint="rail" kp="1000" kv="60"/></actuator>
  <keyframe><key name="sent" qpos=".5" ctrl="{aim}"/></keyframe></mujoco>"""


@pytest.mark.parametrize(("aim", "words"), [(2.0, "beyond its limit"), (1.05, ""), (0.9, "")])
def test_a_servo_that_presses_its_joint_far_beyond_its_limit_is_named(
    aim: float, words: str
) -> None:
    """The stop is a spring of K = 500 N/m for each kilogram, and its impedance d is 0.95.

    At rest, kp (aim - 1 - x) = m x K d^2 / (1 - d): a tenth of the range with aim 2, and half a
    percent with 1.05.
    """
    motion = motion_of(RAIL.format(aim=aim))
    found = [cause.sentence for cause in find_overrun_stop(TaskEnds(motion))]
    assert len(found) == bool(words)
    assert all(words in sentence for sentence in found)
    end = TaskEnds(motion).end.qpos[0]
    yields = 1000 * (aim - 1) / (1000 + 500 * 0.95**2 / 0.05)
    assert end - 1 == pytest.approx(yields if aim > 1 else aim - 1, rel=0.15)
    assert all(f"presses it {1e3 * (end - 1):.2g} mm" in sentence for sentence in found)
