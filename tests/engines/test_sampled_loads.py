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
