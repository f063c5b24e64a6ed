"""A model that nothing can touch, since it has no geoms, as a URDF without collisions."""

import mujoco
import pytest

from contactlab.modifications.model_predicates import may_collide

BARE = """<mujoco><worldbody><body><joint axis="0 1 0"/>
<inertial pos=".1 0 0" mass="1" diaginertia=".01 .01 .01"/>{}</body></worldbody></mujoco>"""


@pytest.mark.parametrize("geoms", [0, 1])
def test_a_model_without_two_geoms_collides_with_nothing(geoms: int) -> None:
    text = BARE.format('<geom size=".1" contype="0"/>' * geoms)
    assert not may_collide(mujoco.MjModel.from_xml_string(text))
