"""Violations of equalities in a few states of a run, which are written by hand."""

from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab.engines.sampled_loads import LoadSampler, sampled_steps

PAIR = """<mujoco><worldbody>
<body><joint name="one" type="slide"/><geom size=".1" mass="1"/></body>
<body pos="1 0 0"><joint name="two" type="slide"/><geom size=".1" mass="1"/></body></worldbody>
<equality><joint joint1="one" joint2="two" solref=".001 1"/></equality></mujoco>"""
STEPS = 4000  # as many as have the most samples


@pytest.mark.parametrize(
    ("begin", "end", "rest"), [(0.0, 0.7, 0.0), (0.3, 0.74, 0.0), (0.76, 1.0, 0.5), (0.5, 1.0, 0.5)]
)
def test_a_lasting_violation_is_that_of_the_last_quarter(
    begin: float, end: float, rest: float
) -> None:
    """Of a joint that stands .5 m off between two shares of the run, the largest is .5 m."""
    model = mujoco.MjModel.from_xml_string(PAIR)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    states = np.zeros((STEPS + 1, 1 + model.nq + model.nv))
    states[:, 0] = model.opt.timestep * np.arange(STEPS + 1)
    states[1 + round(begin * STEPS) : 1 + round(end * STEPS), 1] = 0.5
    inputs = np.zeros((1 + len(sampled_steps(STEPS)), model.nu + 6 * model.nbody))
    start: Any = SimpleNamespace(input_rows=lambda *_: inputs)
    _, gaps, _ = LoadSampler(model).sample_loads(model, start, states)
    assert gaps[0] == pytest.approx([0.5, rest])


BRAKE = """<mujoco><option timestep=".002"/><worldbody><body><joint axis="0 1 0"
frictionloss="{}" solreffriction="{} 1" solimpfriction=".9 .9 .001"/>
<geom type="capsule" fromto="0 0 0 .4 0 0" size=".02" mass="1"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize(("loss", "constant"), [(6, 0.02), (6, 0.2), (0.5, 0.02)])
def test_creep_is_that_of_a_plain_loop_at_its_step(loss: float, constant: float) -> None:
    """A brake below its friction loss creeps; one that slips does not, however fast it turns."""
    model = mujoco.MjModel.from_xml_string(BRAKE.format(loss, constant))
    data = mujoco.MjData(model)
    slips = loss < 1 * 9.81 * 0.2  # the arm's weight times its lever
    steps = 300 if slips else 1000  # so that it has not come to rest
    states, forces = np.zeros((steps + 1, 3)), np.zeros(steps + 1)
    for step in range(steps + 1):
        states[step] = data.time, *data.qpos, *data.qvel
        mujoco.mj_step(model, data)
        forces[step] = np.abs(data.efc_force[0])
    inputs = np.zeros((1 + len(sampled_steps(steps)), 6 * model.nbody))
    start: Any = SimpleNamespace(input_rows=lambda *_: inputs)
    _, _, creep = LoadSampler(model).sample_loads(model, start, states)
    speed, step = creep[:, 0]
    if slips:
        assert speed == 0
    else:
        assert speed == abs(states[int(step), 2]) > 0
        assert forces[int(step)] < 0.9 * loss
        assert step >= steps // 4


def test_a_fall_is_no_creep() -> None:
    """A speed that grows within each quarter is that of a falling body, not of a brake."""
    model = mujoco.MjModel.from_xml_string(BRAKE.format(6, 0.02))
    speeds = np.linspace(0, 1, STEPS + 1) ** 2 * 1e-3
    states = np.stack([np.zeros(STEPS + 1), np.zeros(STEPS + 1), speeds], axis=1)
    inputs = np.zeros((1 + len(sampled_steps(STEPS)), 6 * model.nbody))
    start: Any = SimpleNamespace(input_rows=lambda *_: inputs)
    found = LoadSampler(model).sample_loads(model, start, states)[2]
    assert not found[0].any()
