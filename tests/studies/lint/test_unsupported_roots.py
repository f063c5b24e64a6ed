"""A floating robot falls unless a force from outside its tree can carry it."""

import mujoco
import pytest

from contactlab.scene.floating_bases import list_unsupported_roots

ROBOT = """<mujoco>{option}<worldbody>{world}<site name="hook" pos="0 0 2"/>
<body name="base" pos="0 0 1"><freejoint name="root"/><geom size=".05"/><site name="top"/>
<body name="left" pos=".1 0 0"><joint name="a"/>
<geom size=".02" pos="0 0 .1"/><site name="l"/></body>
<body name="right" pos="-.1 0 0"><joint name="b"/>
<geom size=".02" pos="0 0 .1"/><site name="r"/></body></body></worldbody>{rest}</mujoco>"""
INSIDE = {
    "nothing": "",
    "coupled joints": '<equality><joint joint1="a" joint2="b"/></equality>',
    "a link welded to another": '<equality><weld body1="left" body2="right"/></equality>',
    "a tendon along two joints": '<tendon><fixed name="t"><joint joint="a" coef="1"/>'
    '<joint joint="b" coef="1"/></fixed></tendon><actuator><motor tendon="t"/></actuator>',
    "a cord between links": '<tendon><spatial><site site="l"/><site site="r"/></spatial></tendon>',
    "motors": '<actuator><motor joint="a"/><position joint="b"/></actuator>',
}
OUTSIDE = {
    "a weld to the world": '<equality><weld body1="base" body2="world"/></equality>',
    "a pin in the world": '<equality><connect site1="top" site2="hook"/></equality>',
    "a cord from the ceiling": '<tendon><spatial><site site="hook"/><site site="top"/></spatial>'
    "</tendon>",
    "a thruster": '<actuator><motor site="top" gear="0 0 1 0 0 0"/></actuator>',
    "a motor of its free joint": '<actuator><motor joint="root" gear="0 0 1 0 0 0"/></actuator>',
}


def names_of(option: str = "", world: str = "", rest: str = "") -> list[str]:
    model = mujoco.MjModel.from_xml_string(ROBOT.format(option=option, world=world, rest=rest))
    return [model.body(root).name for root in list_unsupported_roots(model)]


@pytest.mark.parametrize("name", INSIDE)
def test_forces_within_a_robot_carry_nothing(name: str) -> None:
    assert names_of(rest=INSIDE[name]) == ["base"]


@pytest.mark.parametrize("name", OUTSIDE)
def test_forces_from_outside_may_carry_it(name: str) -> None:
    assert names_of(rest=OUTSIDE[name]) == []


@pytest.mark.parametrize(
    ("option", "world"),
    [
        ('<option gravity="0 0 0"/>', ""),
        ('<option density="1000"/>', ""),
        ("", '<geom type="plane" size="1 1 .1"/>'),
    ],
)
def test_without_gravity_in_a_medium_or_above_a_floor_it_is_not_said(
    option: str, world: str
) -> None:
    assert names_of(option, world) == []
