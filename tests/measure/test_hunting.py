"""Actuators that go from one end of their force to the other for ever, told from those that brake.

An antagonist pair pulls a mass on a slide by a stiff law within its force limits: undamped, it is a
relay, which swings for ever; damped, it brakes with all its force, and settles.
"""

from typing import Any

import pytest

WINCHES = """
<mujoco>
  <option timestep=".002" integrator="implicitfast" gravity="0 0 0"/>
  <worldbody><site name="left" pos="-1 0 0"/><site name="right" pos="1 0 0"/>
    <body><joint type="slide" axis="1 0 0"/><geom size=".1" mass="3"/><site name="ring"/></body>
  </worldbody>
  <tendon>
    <spatial name="left"><site site="left"/><site site="ring"/></spatial>
    <spatial name="right"><site site="right"/><site site="ring"/></spatial>
  </tendon>
  <default><position kp="200000" kv="{kv}" forcerange="-100 0"/></default>
  <actuator><position tendon="left"/><position tendon="right"/></actuator>
  <keyframe><key qpos=".1" ctrl=".9999 .9999"/></keyframe>
</mujoco>
"""
SWEEP = "version: 1\nscene: model.xml\nduration: 3\ndrive: none\ntrace: none\naxes: {}\n"


@pytest.mark.parametrize(("kv", "hunts"), [(0, True), (20000, False)])
def test_winches_hunt_that_nothing_damps(sweeper: Any, kv: float, hunts: bool) -> None:
    (sweeper.folder / "model.xml").write_text(WINCHES.format(kv=kv))
    sweeper.run(SWEEP)
    (row,) = sweeper.rows()
    assert ("chatter" in row["labels"]) == hunts, row["label_reasons"]
