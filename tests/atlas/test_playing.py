"""A task that is played by plain steps moves as its motions say."""

from pathlib import Path

import mujoco
import numpy as np
from bench.atlas.playing import moments, real_time

from contactlab.budget.motion import INTEGRATION
from contactlab.tasks.checked_model import open_model
from contactlab.tasks.session import Session

SERVO = """<mujoco><worldbody><body name="arm"><joint name="j" axis="0 1 0" damping="1"/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".02"/></body></worldbody>
<actuator><position joint="j" kp="5" ctrlrange="-1 1"/></actuator></mujoco>"""


def test_states_are_those_after_steps_at_equal_times(tmp_path: Path) -> None:
    file = tmp_path / "servo.xml"
    file.write_text(SERVO)
    motions = open_model(str(file), Session(tmp_path, 0)).motions
    model, seen = motions[0].model, moments(motions)
    data, own = mujoco.MjData(model), np.empty(mujoco.mj_stateSize(model, INTEGRATION))
    mujoco.mj_setState(model, data, motions[0].starts[0], INTEGRATION)
    every = list[np.ndarray]()
    for motion in motions:
        for row in motion.inputs[0]:
            mujoco.mj_setState(model, data, row, motion.spec)
            mujoco.mj_step(model, data)
            mujoco.mj_getState(model, data, own, INTEGRATION)
            every.append(own.copy())
    places = np.linspace(0, len(every) - 1, len(seen)).astype(int)
    positions = slice(1, 1 + model.nq + model.nv)
    assert np.allclose(seen[:, positions], np.array(every)[places][:, positions], atol=1e-9)
    assert real_time(motions) > 0
