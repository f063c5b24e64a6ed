"""The start that limits, contacts and equalities allow, nearest to one that they do not."""

import mujoco
import numpy as np
import pytest

from contactlab.scene.closed_start import closed_start

FULL = int(mujoco.mjtState.mjSTATE_INTEGRATION)


def positions(xml: str) -> np.ndarray | None:
    """Return the allowed positions next to those that a model's file has."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    state = np.zeros(mujoco.mj_stateSize(model, FULL))
    mujoco.mj_getState(model, data, state, FULL)
    return closed_start(model, state, FULL)


def test_a_joint_beyond_its_limit_begins_at_the_limit() -> None:
    xml = """<mujoco><worldbody><body><joint range="-30 60"/><geom size=".1" pos=".3 0 0"/></body>
    </worldbody><keyframe><key qpos="1.4"/></keyframe></mujoco>"""
    assert positions(xml) == pytest.approx([np.pi / 3], abs=1e-5)
    assert positions(xml.replace("1.4", "1")) is None


def test_bodies_in_each_other_part_as_their_masses_say() -> None:
    """Of all ways to part by d, m1 x1^2 + m2 x2^2 is least where m1 x1 = m2 x2: x1 = d m2 / M."""
    xml = """<mujoco><option gravity="0 0 0"/><worldbody>
    <body pos="0 0 0"><freejoint/><geom size=".1" mass="3"/></body>
    <body pos=".15 0 0"><freejoint/><geom size=".1" mass="1"/></body></worldbody></mujoco>"""
    apart = positions(xml)
    assert apart is not None
    assert apart[[0, 7]] == pytest.approx([-0.05 / 4, 0.15 + 3 * 0.05 / 4], abs=1e-5)


@pytest.mark.parametrize("hall", [0, 100])
def test_a_ball_in_the_floor_is_lifted_however_large_the_hall(hall: float) -> None:
    """It is a fifth of its size deep: a hall of a hundred metres makes that no less."""
    xml = f"""<mujoco><worldbody><geom type="plane" size="1 1 .1"/>
    <geom type="box" size=".1 .1 .1" pos="{hall} 0 0" contype="0" conaffinity="0"/>
    <body pos="0 0 .06"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""
    lifted = positions(xml)
    assert lifted is not None
    assert lifted[2] == pytest.approx(0.1, abs=1e-5)


def test_an_open_equality_closes_by_the_way_that_is_open() -> None:
    """A pin half a metre ahead of a cart's eye: the cart rolls there, and nothing turns."""
    xml = """<mujoco><worldbody><body name="cart"><joint type="slide" axis="1 0 0"/>
    <geom size=".1"/><site name="eye" pos=".2 0 0"/></body><site name="pin" pos=".7 0 0"/>
    </worldbody><equality><connect site1="eye" site2="pin"/></equality></mujoco>"""
    assert positions(xml) == pytest.approx([0.5], abs=1e-5)


def test_wheels_of_a_gear_turn_to_where_their_teeth_fit() -> None:
    """With q1 = 2 q2 + 1, q1^2 + 4 q2^2 is least at q1 = 1/2 and q2 = -1/4."""
    xml = """<mujoco><option gravity="0 0 0"/><worldbody>
    <body><joint name="one"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
    <body><joint name="two"/><inertial pos="0 0 0" mass="1" diaginertia="4 4 4"/></body>
    </worldbody>
    <equality><joint joint1="one" joint2="two" polycoef="1 2 0 0 0"/></equality></mujoco>"""
    assert positions(xml) == pytest.approx([0.5, -0.25], abs=1e-5)


def test_what_cannot_be_closed_is_left() -> None:
    """A hinge of .3 m does not reach a pin that is a metre away."""
    xml = """<mujoco><worldbody><body><joint axis="0 1 0"/><geom size=".1" pos=".2 0 0"/>
    <site name="tip" pos=".3 0 0"/></body><site name="pin" pos="0 0 1"/></worldbody>
    <equality><connect site1="tip" site2="pin"/></equality></mujoco>"""
    assert positions(xml) is None
