"""Velocities of bodies, as they are read from states."""

import warnings

import mujoco
import numpy as np

from contactlab.budget.motion import INTEGRATION
from contactlab.budget.windows import Observer, select_parts

BALL = """<mujoco><worldbody><body><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""


def test_a_diverged_state_has_no_velocity_and_no_warning() -> None:
    model = mujoco.MjModel.from_xml_string(BALL)
    data, start = mujoco.MjData(model), np.empty(mujoco.mj_stateSize(model, INTEGRATION))
    rows = list[np.ndarray]()
    for speed in (2.0, np.inf):
        data.qvel[:] = (0, 0, 3, 0, 0, speed)
        mujoco.mj_getState(model, data, start, INTEGRATION)
        rows.append(start.copy())
    observer = Observer(model, rows[0], np.array([1]), 1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        velocities, _ = observer(select_parts(model, np.array(rows)))
    np.testing.assert_allclose(velocities[0, 0, :3], (0, 0, 3), atol=1e-12)
    assert not np.isfinite(velocities[1]).all()
