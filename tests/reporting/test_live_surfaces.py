"""Textures as pages that simulate draw them."""

import mujoco
import numpy as np

from contactlab.live.surfaces import textures_of

MODEL = """
<mujoco>
  <asset>
    <texture name="grid" type="2d" builtin="checker" rgb1="1 0 0" rgb2="0 0 1" width="600"
             height="400"/>
    <texture name="skin" type="cube" builtin="flat" rgb1=".2 .4 .6" rgb2="0 0 0" width="30"
             height="30"/>
    <texture name="sky" type="skybox" builtin="gradient" width="30" height="30"/>
    <material name="plain"/>
    <material name="floor" texture="grid" texrepeat="3 4" texuniform="true"/>
    <material name="body" texture="skin"/>
  </asset>
  <worldbody><geom type="plane" size="1 1 .1" material="floor"/></worldbody>
</mujoco>
"""


def test_pictures_are_small_and_keep_their_mean() -> None:
    """A block's mean is rounded to a step of colour, so that the mean of all is off by half one."""
    model = mujoco.MjModel.from_xml_string(MODEL)
    floor, body = textures_of(model)
    assert (model.material(floor.material).name, model.material(body.material).name) == (
        "floor",
        "body",
    )
    assert floor.picture is not None
    assert max(floor.picture.shape) <= 256
    half_a_step = 0.5 / 255
    np.testing.assert_allclose(
        floor.picture[:, :, :3].mean(axis=(0, 1)) / 255, floor.mean, rtol=0, atol=half_a_step
    )
    np.testing.assert_allclose(floor.mean, (0.5, 0, 0.5), rtol=0, atol=half_a_step)
    assert floor.repeat == (3, 4)
    assert floor.uniform
    assert body.picture is None
    # MuJoCo gives the last of six sides the second colour.
    sides = np.array([0.2, 0.4, 0.6]) * 5 / 6
    np.testing.assert_allclose(body.mean, sides, rtol=0, atol=half_a_step)
    assert not body.uniform
