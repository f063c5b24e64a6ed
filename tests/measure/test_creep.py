"""What friction should hold and does not is seen, by how far it gets for its size."""

from typing import Any

import numpy as np
import pytest

# A crate, or two of which the upper is the heavier, on a slope that friction would hold.
SLOPE = """
<mujoco>
  <option gravity="2 0 -9.6" cone="elliptic" impratio="{impratio}" timestep=".005"/>
  <default><geom friction=".6" solimp=".9 .9 .001"/></default>
  <worldbody><geom type="plane" size="9 9 .1"/>
    <body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/></body>{upper}
  </worldbody>
</mujoco>
"""
UPPER = '<body pos="0 0 .3"><freejoint/><geom type="box" size=".1 .1 .1" mass="{}"/></body>'.format
ROLLING = """
<mujoco><worldbody><geom type="plane" size="9 9 .1"/><body pos="0 0 .1"><freejoint/>
  <geom size=".1" mass="1"/></body></worldbody>
  <keyframe><key qpos="0 0 .1 1 0 0 0" qvel="1 0 0 0 10 0"/></keyframe></mujoco>
"""
SWEEP = "version: 1\nscene: model.xml\nduration: 4\ndrive: none\ntrace: none\naxes: {}\n"


def row_of(sweeper: Any, model: str) -> dict[str, Any]:
    (sweeper.folder / "model.xml").write_text(model)
    sweeper.run(SWEEP)
    (row,) = sweeper.rows()
    return row


@pytest.mark.parametrize(
    ("impratio", "mass", "creeps"), [(1, 20, True), (1, 0, False), (50, 20, False)]
)
def test_stack_on_a_slope_creeps_by_its_size(
    sweeper: Any, impratio: int, mass: int, creeps: bool
) -> None:
    row = row_of(sweeper, SLOPE.format(impratio=impratio, upper=UPPER(mass) if mass else ""))
    assert (row["crept"] > 0.03) == creeps, row["crept"]
    assert ("creep" in row["labels"]) == creeps


def test_creep_is_the_speed_of_slip_over_the_size(sweeper: Any) -> None:
    row = row_of(sweeper, SLOPE.format(impratio=1, upper=""))
    # The crate slips as it moves, and its reach from its frame is that of the sphere about it.
    assert row["crept"] == pytest.approx(row["creep_speed"] / (0.2 * np.sqrt(3)), rel=0.01)


def test_what_rolls_does_not_creep(sweeper: Any) -> None:
    row = row_of(sweeper, ROLLING)
    assert row["drift"] > 3
    assert row["crept"] < 0.0025


def test_what_a_belt_carries_does_not_creep(sweeper: Any) -> None:
    """The crate goes as the belt does, by friction: 4 s of .3 m/s, but for its start."""
    belt = """<mujoco><option timestep=".005"/><worldbody>
      <geom type="plane" size="9 9 .1" surfacevel=".3 0 0 0 0 0"/>
      <body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/></body>
      </worldbody></mujoco>"""
    row = row_of(sweeper, belt)
    assert row["drift"] == pytest.approx(1.2, rel=0.02)
    assert row["crept"] is None
    assert "creep" not in row["labels"]


def test_what_no_friction_holds_does_not_creep(sweeper: Any) -> None:
    """A follower on a cam slips all the time, and condim 1 gives it nothing to stick by."""
    row = row_of(
        sweeper,
        """<mujoco><option timestep=".002"/><default><geom condim="1" solref=".004 1"/></default>
        <worldbody><body><joint name="cam" axis="0 1 0"/><geom size=".05" pos=".01 0 0" mass="1"/>
        </body><body pos="0 0 .07"><joint type="slide" axis="0 0 1" damping="5"/>
        <geom type="box" size=".05 .02 .02" mass="1"/></body></worldbody>
        <actuator><velocity joint="cam" kv="1"/></actuator>
        <keyframe><key qvel="5 0" ctrl="5"/></keyframe></mujoco>""",
    )
    assert row["crept"] == 0
    assert row["labels"] == ["stable"]
