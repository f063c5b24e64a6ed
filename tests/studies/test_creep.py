"""What creeps: as fast as a plain loop sees it go, and never what slides or is held."""

import mujoco
import numpy as np
import pytest

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.schema.examination import Fact
from contactlab.studies.examine.facts import list_facts

_STEPS = 500
# Gravity pulls by 30 % of what it presses with, well within a friction of 0.8.
BOX = """<mujoco><option gravity="3 0 -10" timestep="0.002"{option}/><worldbody>
  <geom name="floor" type="plane" size="5 5 .1"{floor} friction="{friction} .005 .0001"/>
  <body name="crate" pos="0 0 .05"><freejoint/>
    <geom name="crate" type="{shape}" size=".05 .05 .05" mass="1"
      friction="{friction} .005 .0001"/></body></worldbody></mujoco>"""


def creeping(
    option: str = "", friction: float = 0.8, shape: str = "box", floor: str = ""
) -> tuple[list[Fact], float]:
    """Return the facts of creep, and the speed at the end by a loop over `mj_step` [m/s]."""
    text = BOX.format(option=option, friction=friction, shape=shape, floor=floor)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    start = np.empty((1, mujoco.mj_stateSize(model, INTEGRATION)))
    mujoco.mj_getState(model, data, start[0], INTEGRATION)
    motion = Motion(model, start, np.empty((1, _STEPS, 0)))
    places = list[float]()
    for _ in range(_STEPS):
        mujoco.mj_step(model, data)
        places.append(float(data.qpos[0]))
    late = places[-_STEPS // 5 :]
    speed = (late[-1] - late[0]) / ((len(late) - 1) * model.opt.timestep)
    return [fact for fact in list_facts([motion], [0.0]) if fact.kind == "creep"], speed


@pytest.mark.parametrize("option", ["", ' cone="elliptic"'])
def test_a_box_on_a_slope_creeps_as_fast_as_it_goes(option: str) -> None:
    (fact,), speed = creeping(option)
    # Its windows and the loop's steps are the same stretch, to a window of 10 ms.
    assert fact.value == pytest.approx(speed, rel=0.02)
    assert f"{1e3 * speed:.2g} mm/s" in fact.sentence


@pytest.mark.skipif(
    not hasattr(mujoco.MjModel, "geom_surfacevel"), reason="MuJoCo has no surface velocity"
)
def test_what_a_belt_carries_creeps_along_the_belt_alone() -> None:
    (fact,), speed = creeping(floor=' surfacevel=".3 0 0 0 0 0"')
    assert fact.value == pytest.approx(speed - 0.3, rel=0.02)


def test_what_noslip_holds_does_not_creep() -> None:
    assert creeping(' noslip_iterations="20"')[0] == []


def test_what_slides_does_not_creep() -> None:
    found, speed = creeping(friction=0.2)
    assert speed > 0.5
    assert found == []


def test_what_rolls_creeps_only_as_it_slips() -> None:
    """Friction that turns a ball is as soft as any."""
    (fact,), speed = creeping(shape="sphere")
    assert fact.value < 1e-2 * speed
