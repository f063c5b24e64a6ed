"""Energy and momenta of states, by hand."""

import mujoco
import numpy as np
import pytest

from contactlab.accuracy.reference import state_invariants

BALL = """
<mujoco>
  <option gravity="0 0 -10"/>
  <worldbody>
    <body pos="0 0 100"><freejoint/><geom size=".1" mass="3"/></body>
  </worldbody>
</mujoco>
"""


def test_energy_and_momenta_are_those_of_the_motion() -> None:
    """1 m/s and 2 rad/s: m v^2 / 2 + 2/5 m r^2 w^2 / 2, and what it weighs at 100 m."""
    model = mujoco.MjModel.from_xml_string(BALL)
    qpos = np.array([[0, 0, 100, 1, 0, 0, 0.0]])
    qvel = np.array([[1, 0, 0, 0, 0, 2.0]])
    found = state_invariants(model, qpos, qvel, free=True)
    kinetic = 1.5 + 0.5 * 0.4 * 3 * 0.01 * 4
    assert found.kinetic == pytest.approx([kinetic], rel=1e-12)
    assert found.energy == pytest.approx([kinetic + 3 * 10 * 100], rel=1e-12)
    assert found.momentum is None, "gravity takes momentum away"
    assert found.lift == pytest.approx(3 * 10 * 1e-3)
    model.opt.gravity[:] = 0
    still = state_invariants(model, qpos, qvel, free=True)
    assert still.momentum == pytest.approx(np.array([[3.0, 0, 0]]), abs=1e-12)
    assert still.angular_momentum == pytest.approx(
        np.array([[0, 0, 0.4 * 3 * 0.01 * 2]]), abs=1e-12
    )
