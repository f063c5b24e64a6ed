"""A timestep that is written into a compiled flex gives the model that MuJoCo compiles with it."""

import mujoco
import numpy as np
import pytest

from contactlab.scene.model_edits import set_timestep

CLOTH = """
<mujoco><option timestep="{timestep}" integrator="discrete"/>
<worldbody><geom type="plane" size="1 1 .1"/>
  <flexcomp name="cloth" type="grid" count="4 4 1" spacing=".05 .05 .05" pos="0 0 .13" dim="2"
    radius=".004" mass=".1"><elasticity young="3e5" thickness="8e-3" elastic2d="both"/></flexcomp>
</worldbody></mujoco>
"""


@pytest.mark.skipif(not hasattr(mujoco.MjModel, "efm0_L"), reason="MuJoCo integrates no flex so")
def test_factors_follow_the_timestep() -> None:
    coarse, fine = (
        mujoco.MjModel.from_xml_string(CLOTH.format(timestep=step)) for step in (0.004, 0.001)
    )
    assert not np.array_equal(coarse.efm0_L, fine.efm0_L)
    set_timestep(coarse, 0.001)
    assert np.array_equal(coarse.efm0_L, fine.efm0_L)
    assert coarse.opt.timestep == fine.opt.timestep
