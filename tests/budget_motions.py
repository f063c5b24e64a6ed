"""Small models and the motions that budgets are of in tests."""

import mujoco
import numpy as np

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION


def motion_of(
    xml: str,
    seconds: float,
    *,
    qpos: list[float] | None = None,
    qvel: list[float] | None = None,
    controls: np.ndarray | None = None,
    name: str = "",
) -> Motion:
    """Start a model once; controls are (seeds, steps, nu), none of them by default."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    if qpos is not None:
        data.qpos[:] = qpos
    if qvel is not None:
        data.qvel[:] = qvel
    start = np.empty(mujoco.mj_stateSize(model, INTEGRATION))
    mujoco.mj_getState(model, data, start, INTEGRATION)
    steps = round(seconds / model.opt.timestep)
    inputs = np.zeros((1, steps, 0)) if controls is None else controls
    return Motion(model, np.tile(start, (len(inputs), 1)), inputs, name=name)


# Two bodies that touch the floor under motors, so that windows have impacts, friction and limits.
WALKER = """
<mujoco>
  <option timestep="{step}" integrator="{integrator}" solver="{solver}" iterations="{iterations}"/>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1"/>
    <body name="trunk" pos="0 0 .5">
      <joint name="lift" type="slide" axis="0 0 1"/>
      <joint name="along" type="slide" axis="1 0 0"/>
      <joint name="pitch" axis="0 1 0" damping=".05"/>
      <geom type="capsule" size=".05" fromto="-.2 0 0 .2 0 0"/>
      <body name="leg" pos=".2 0 0">
        <joint name="knee" axis="0 1 0" range="-60 60" damping=".02"/>
        <geom type="capsule" size=".04" fromto="0 0 0 0 0 -.35"/>
      </body>
      <body name="arm" pos="-.2 0 0">
        <joint name="elbow" axis="0 1 0" range="-60 60" damping=".02"/>
        <geom type="capsule" size=".04" fromto="0 0 0 -.1 0 -.35"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor joint="knee" ctrlrange="-1 1" gear="8"/>
    <motor joint="elbow" ctrlrange="-1 1" gear="8"/>
  </actuator>
</mujoco>
"""


def walker(
    step: float = 0.005,
    seeds: int = 2,
    seconds: float = 0.4,
    *,
    integrator: str = "Euler",
    solver: str = "Newton",
    iterations: int = 100,
) -> Motion:
    """Drive the walker by sines that all steps see alike, held for 20 ms."""
    xml = WALKER.format(step=step, integrator=integrator, solver=solver, iterations=iterations)
    time = np.floor(np.arange(round(seconds / step)) * step / 0.02 + 1e-9) * 0.02
    phase = np.random.default_rng(0).uniform(0, 6, (seeds, 1, 2))
    controls = np.sin(phase + 9 * time[:, None] * np.array([1.0, 1.3]))
    return motion_of(xml, seconds, controls=controls)
