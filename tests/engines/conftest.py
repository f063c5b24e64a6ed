"""Models to roll out, and the slow obvious loop that a rollout must equal."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
import pytest

from contactlab.engines import Buffers, Rollout
from contactlab.engines.mujoco_batch import roll_out
from contactlab.scene.compiled_scene import PreparedModel
from contactlab.scene.initial_states import InitialStates
from contactlab.scene.mujoco_versions import silence_mujoco
from contactlab.scene.scene import Scene

# Every kind of thing that a setting can act on: free and jointed bodies, springs, dry friction, a
# limit, a motor, a weld to a mocap body, unequal geoms, priorities and an explicit pair.
MIXED = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1" friction="0.8 0.01 0.001"/>
    <body name="box" pos="0 0 .049">
      <freejoint name="box"/>
      <geom name="box" type="box" size=".05 .05 .05" mass="1" friction="0.3 0.02 0.002"
            solref="0.01 0.7" solmix="2" condim="4"/>
    </body>
    <body name="ball" pos=".02 0 .145">
      <freejoint name="ball"/>
      <geom name="ball" size=".05" density="500" priority="1" condim="4"/>
    </body>
    <body name="arm" pos=".5 0 .2">
      <joint name="hinge" axis="0 1 0" stiffness="1" damping=".1" frictionloss=".02" range="-20 20"
             limited="true"/>
      <geom name="arm" type="capsule" fromto="0 0 0 .2 0 -.17" size=".02"/>
    </body>
    <body name="hand" mocap="true" pos="-.5 0 .26">
      <geom name="hand" size=".02"/>
    </body>
    <body name="held" pos="-.5 0 .3"><freejoint name="held"/><geom name="held" size=".03"/></body>
  </worldbody>
  <equality><weld name="grip" body1="hand" body2="held"/></equality>
  <actuator><motor name="motor" joint="hinge" ctrlrange="-1 1" ctrllimited="true"/></actuator>
  <contact>
    <pair name="rub" geom1="floor" geom2="arm" friction="0.4 0.5 0.01 0.001 0.001"/>
  </contact>
</mujoco>
"""


class Recorded(NamedTuple):
    """What a plain loop saw: the state before each step and after the last, and in each step."""

    state: np.ndarray
    sensors: np.ndarray
    iterations: np.ndarray


def loop(model: mujoco.MjModel, starts: InitialStates, run: int, steps: int) -> Recorded:
    """Step one run with mj_step."""
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = starts.qpos[run], starts.qvel[run], starts.ctrl[run]
    data.xfrc_applied[:] = starts.applied[run].reshape(-1, 6)
    rows: list[tuple[np.ndarray, ...]] = []
    for step in range(steps):
        signals = starts.signals[run]
        times = np.broadcast_to(signals.times, signals.levels.shape)
        for place, knots, levels in zip(signals.places, times, signals.levels, strict=True):
            target = data.ctrl if place < model.nu else data.xfrc_applied.reshape(-1)
            target[place - model.nu * (place >= model.nu)] = np.interp(
                step * model.opt.timestep, knots, levels
            )
        before = np.concatenate([[data.time], data.qpos, data.qvel, data.act])
        mujoco.mj_step(model, data)
        rows.append((before, data.sensordata.copy(), data.solver_niter.copy()))
    states, sensors, iterations = (np.array(part) for part in zip(*rows, strict=True))
    last = np.concatenate([[data.time], data.qpos, data.qvel, data.act])
    return Recorded(np.concatenate([states, last[None]]), sensors, iterations)


def assert_equal_bits(rollout: Rollout, run: int, expected: Recorded) -> None:
    """Compare all that a run recorded with a plain loop, as bytes, up to where it stopped."""
    assert rollout.errors[run] is None
    steps = rollout.steps[run]
    assert steps == len(expected.sensors) or rollout.warnings[run]
    assert rollout.state[run, : steps + 1].tobytes() == expected.state[: steps + 1].tobytes()
    assert rollout.sensors[run, :steps].tobytes() == expected.sensors[:steps].tobytes()
    assert rollout.iterations[run, :steps].tobytes() == expected.iterations[:steps].tobytes()


class Rolled(NamedTuple):
    """A group of runs, rolled out."""

    scene: Scene
    prepared: list[PreparedModel]
    starts: InitialStates
    rollout: Rollout

    def assert_equals_loop(self, steps: int) -> None:
        """Compare every run with a plain loop."""
        for run, prepared in enumerate(self.prepared):
            expected = loop(prepared.model, self.starts, run, steps)
            assert_equal_bits(self.rollout, run, expected)


def roll(scene: Scene, values: Sequence[dict[str, Any]], steps: int) -> Rolled:
    """Roll out runs of one structure, with seeds 0, 1, ..."""
    runs = [scene.resolve(each, seed, None) for seed, each in enumerate(values)]
    base = scene.base(runs[0].structure)
    prepared = [base.prepare(run.list_edits()) for run in runs]
    starts = scene.initial_states(runs)
    models = [each.model for each in prepared]
    return Rolled(scene, prepared, starts, roll_out(models, starts, steps, Buffers()))


MakeScene = Callable[..., Scene]
HEAD = "version: 1\ntitle: t\ndescription: d\nduration: 0.1\n"


@pytest.fixture(scope="session", autouse=True)
def silent() -> None:
    """Keep diverging runs from writing a log."""
    silence_mujoco()


@pytest.fixture(scope="session")
def make_scene(tmp_path_factory: pytest.TempPathFactory) -> MakeScene:
    """Return a maker of scenes from MJCF text, and manifest text where there is one."""

    def make(model: str, manifest: str | None = None) -> Scene:
        folder = tmp_path_factory.mktemp("scene")
        (folder / "scene.xml").write_text(model)
        if manifest is None:
            return Scene.open(str(folder / "scene.xml"))
        (folder / "scene.yaml").write_text(HEAD + manifest)
        return Scene.open(str(folder))

    return make


@pytest.fixture(scope="session")
def mixed(make_scene: MakeScene) -> Scene:
    """Return the scene of the mixed model."""
    return make_scene(MIXED)


@pytest.fixture(scope="session", name="roll")
def roll_fixture() -> Callable[..., Rolled]:
    """Return `roll`."""
    return roll


@pytest.fixture(scope="session", name="loop")
def loop_fixture() -> Callable[..., Recorded]:
    """Return `loop`."""
    return loop
