"""Models whose floor is in another file, and models that MuJoCo does not let sleep."""

import mujoco
import pytest

from contactlab.modifications.model_predicates import lacks_surroundings, may_sleep

WORLD = """<mujoco><option gravity="{gravity}"/><worldbody>{floor}
  <body name="torso" pos="0 0 1">{joint}<geom name="torso" size=".1"/>
    <body pos="0 0 -.5"><joint axis="0 1 0"/><geom name="leg" size=".05"/></body></body>
</worldbody>{more}</mujoco>"""
FREE, SLIDE = "<freejoint/>", '<joint name="rootz" type="slide" axis="0 0 1"/>'
LIMITED = '<joint type="slide" axis="0 0 1" range="0 1" limited="true"/>'
FLOOR = '<geom type="plane" size="1 1 1"/>'


def build_model(**parts: str) -> mujoco.MjModel:
    fill = {"gravity": "0 0 -9.81", "floor": "", "joint": FREE, "more": ""} | parts
    return mujoco.MjModel.from_xml_string(WORLD.format(**fill))


@pytest.mark.parametrize(
    ("parts", "lacks"),
    [
        ({}, True),
        ({"joint": SLIDE}, True),
        ({"floor": FLOOR}, False),
        ({"floor": '<geom size=".1" contype="0" conaffinity="0"/>'}, True),
        ({"gravity": "0 0 0"}, False),
        ({"joint": '<joint axis="0 1 0"/>'}, False),
        ({"joint": LIMITED}, False),
        ({"joint": '<joint type="slide" axis="1 0 0"/>'}, False),
        ({"joint": SLIDE, "more": '<actuator><motor joint="rootz"/></actuator>'}, False),
    ],
)
def test_a_robot_that_falls_past_nothing_lacks_its_floor(
    parts: dict[str, str], lacks: bool
) -> None:
    assert lacks_surroundings(build_model(**parts)) == lacks


def test_equalities_of_tendons_forbid_sleep() -> None:
    tendon = """<tendon><fixed name="cord"><joint joint="rootz" coef="1"/></fixed></tendon>
      <equality><tendon tendon1="cord"/></equality>"""
    if not may_sleep(build_model(joint=SLIDE)):
        pytest.skip("this MuJoCo has no sleep")
    assert not may_sleep(build_model(joint=SLIDE, more=tendon))
