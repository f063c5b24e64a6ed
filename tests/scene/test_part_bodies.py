"""The bodies that a part acts on are those that its definition names."""

import mujoco
import pytest

from contactlab.scene.part_bodies import (
    bodies_of_actuator,
    bodies_of_equality,
    bodies_of_tendon,
    moving_bodies,
)

MODEL = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
<site name="hook"/><geom name="floor" type="plane" size="1 1 1"/><body name="post"><geom size=".1"/>
</body>
<body name="arm" pos="0 0 1"><joint name="swing" axis="0 1 0"/><geom size=".1"/><site name="eye"/>
<body name="hand" pos=".3 0 0"><joint name="wrist"/><geom name="fist" size=".1"/>
<site name="tip"/></body></body>
<body name="cup" pos="1 0 1"><freejoint/><geom size=".1"/></body></worldbody>
<tendon><spatial name="cord"><site site="hook"/><geom geom="fist"/><site site="eye"/></spatial>
<fixed name="sum"><joint joint="swing" coef="1"/><joint joint="wrist" coef="1"/></fixed></tendon>
<actuator><motor name="at joint" joint="wrist"/><motor name="at tendon" tendon="sum"/>
<motor name="at site" site="tip" refsite="hook"/><adhesion name="at body" body="cup"
ctrlrange="0 1" gain="1"/></actuator>
<equality><weld name="glue" body1="cup" body2="hand"/><connect name="pin" site1="eye" site2="hook"/>
<joint name="gear" joint1="wrist" joint2="swing"/><joint name="lock" joint1="swing"/>
<tendon name="rope" tendon1="cord"/></equality></mujoco>""")


@pytest.mark.parametrize(
    ("part", "bodies"),
    [("cord", ("hand", "arm")), ("sum", ("arm", "hand"))],
)
def test_tendons(part: str, bodies: tuple[str, ...]) -> None:
    assert bodies_of_tendon(MODEL, MODEL.tendon(part).id) == bodies


@pytest.mark.parametrize(
    ("part", "bodies"),
    [
        ("at joint", ("hand",)),
        ("at tendon", ("arm", "hand")),
        ("at site", ("hand",)),
        ("at body", ("cup",)),
    ],
)
def test_actuators(part: str, bodies: tuple[str, ...]) -> None:
    assert bodies_of_actuator(MODEL, MODEL.actuator(part).id) == bodies


@pytest.mark.parametrize(
    ("part", "bodies"),
    [
        ("glue", ("cup", "hand")),
        ("pin", ("arm",)),
        ("gear", ("hand", "arm")),
        ("lock", ("arm",)),
        ("rope", ("hand", "arm")),
    ],
)
def test_equalities(part: str, bodies: tuple[str, ...]) -> None:
    assert bodies_of_equality(MODEL, MODEL.equality(part).id) == bodies


def test_what_cannot_move_is_left_out_and_each_is_named_once() -> None:
    everything = [*range(MODEL.nbody), *range(MODEL.nbody)]
    assert moving_bodies(MODEL, everything) == ("arm", "hand", "cup")
