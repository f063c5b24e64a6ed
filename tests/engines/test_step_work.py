"""The work that is entered for each step, against a slow loop and against energy."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab.engines.rollout_trace import make_trace

# An arm with a servo, a motor, dampers and a joint limit, over a floor that it hits.
ARM = """
<mujoco>
  <option timestep="0.002" integrator="{integrator}"/>
  <worldbody>
    <geom type="plane" size="2 2 .1"/>
    <body pos="0 0 .35"><joint name="a" axis="0 1 0" damping=".3" limited="true" range="-90 70"/>
      <geom type="capsule" size=".03" fromto="0 0 0 .3 0 0" mass=".6"/>
      <body pos=".3 0 0"><joint name="b" axis="0 1 0" damping=".05"/>
        <geom type="capsule" size=".02" fromto="0 0 0 .25 0 0" mass=".3"/></body></body>
  </worldbody>
  <actuator>
    <position name="servo" joint="a" kp="20" kv="{kv}" ctrlrange="-2 2"/>
    <motor name="motor" joint="b" ctrlrange="-1 1"/>
  </actuator>
</mujoco>
"""


def slow_work(model: mujoco.MjModel, start: Any, steps: int) -> np.ndarray:
    """Return the work of actuators, constraints and dampers in each step, by a loop."""
    data, work = mujoco.MjData(model), np.zeros((steps, 3))
    data.qpos[:], data.qvel[:], data.ctrl[:] = start.qpos[0], start.qvel[0], start.ctrl[0]
    for step in range(steps):
        before = data.qvel.copy()
        mujoco.mj_step(model, data)
        moved = model.opt.timestep * (before + data.qvel) / 2
        # Euler is implicit in dampers, which so brake by the velocity after the step.
        damping = -model.dof_damping * data.qvel
        forces = data.qfrc_actuator, data.qfrc_constraint, damping
        work[step] = [moved @ force for force in forces]
    return work


def test_work_is_that_of_a_loop(make_scene: Callable[..., Any], roll: Callable[..., Any]) -> None:
    scene = make_scene(ARM.format(integrator="Euler", kv=0))
    rolled = roll(scene, [{}, {"timestep": 1e-3}], 200)
    for run, prepared in enumerate(rolled.prepared):
        expected = slow_work(prepared.model, rolled.starts.select_run(run), 200)
        work = rolled.rollout.work[run]
        scale = np.abs(expected).max()
        # The last step's dampers count as before it: what follows it is not recorded.
        np.testing.assert_allclose(work[:-1], expected[:-1], rtol=0, atol=1e-12 * scale)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "implicit"])
def test_work_explains_the_change_of_energy(
    integrator: str, make_scene: Callable[..., Any], roll: Callable[..., Any]
) -> None:
    """What is left unexplained falls with the step, as the integrators are of first order."""
    left: list[float] = []
    for timestep in (2e-3, 5e-4):
        scene = make_scene(ARM.format(integrator=integrator, kv=2))
        rolled = roll(scene, [{"timestep": timestep}], round(0.4 / timestep))
        trace = make_trace(scene.base({}), rolled.prepared, rolled.rollout)
        energies = trace.kinetic[0] + trace.potential[0]
        done = rolled.rollout.work[0, :-1].sum(axis=1)
        unexplained = np.abs(np.cumsum(np.diff(energies) - done)).max()
        left.append(unexplained / trace.kinetic[0].max())
    # A quarter of the step leaves about a quarter; half, with room for the impact.
    assert left[0] < 0.05
    assert left[1] < left[0] / 2
