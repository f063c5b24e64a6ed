"""Joints in motion at the start of a run."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from contactlab.scene.initial_states import joint_directions
from contactlab.scene.scene import Scene

MODEL = """<mujoco><worldbody>
  <body name="trunk"><freejoint/><geom size=".1"/>
    <body><joint name="hinge"/><geom size=".1" pos=".3 0 0"/>
      <body><joint name="ball" type="ball"/><geom size=".1" pos=".5 0 0"/></body></body></body>
  <body name="free" pos="2 0 0"><freejoint/><geom size=".1"/></body>
  <body pos="4 0 0"><joint name="slide" type="slide"/><geom size=".1"/></body>
</worldbody></mujoco>"""


def test_speeds_of_each_kind_of_joint() -> None:
    model = mujoco.MjModel.from_xml_string(MODEL)
    velocity = joint_directions(model, seed=4)
    trunk, hinge, ball, free, slide = np.split(velocity, [6, 7, 10, 16])
    assert not trunk.any()
    assert abs(hinge[0]) == 1
    assert np.linalg.norm(ball) == pytest.approx(1)
    assert not free[:3].any()
    assert np.linalg.norm(free[3:]) == pytest.approx(1)
    assert abs(slide[0]) == model.stat.meansize
    assert not np.array_equal(velocity, joint_directions(model, seed=5))


def test_an_axis_sets_joints_in_motion(tmp_path: Path) -> None:
    path = tmp_path / "model.xml"
    path.write_text(MODEL)
    scene = Scene.open(str(path))
    still, moving = (scene.resolve(values, 0, 1.0) for values in ({}, {"joint_speed": 2.5}))
    starts = scene.initial_states([still, moving])
    assert not starts.qvel[0].any()
    np.testing.assert_array_equal(starts.qvel[1], 2.5 * joint_directions(scene.base({}).model, 0))
    np.testing.assert_array_equal(starts.qpos[0], starts.qpos[1])
    assert scene.run_id(still) != scene.run_id(moving)
