"""Runs that diverge or that the engine refuses are cut and reported; others are unaffected."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab.engines import Buffers, Rollout
from contactlab.engines.mujoco_batch import roll_out
from contactlab.engines.rollout_trace import make_trace, trajectory_hash
from contactlab.scene.compiled_scene import CompiledScene, PreparedModel
from contactlab.scene.initial_states import InitialStates
from contactlab.scene.mujoco_versions import silence_mujoco
from contactlab.scene.scene import Scene

STEPS = 60
# The engine's own switch for automatic resets is left as MuJoCo has it: on.
MODEL = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1"/>
    <body name="ball" pos="0 0 .06">
      <freejoint name="ball"/><geom name="ball" size=".05" mass="1"/>
    </body>
  </worldbody>
</mujoco>
"""
EXPLODING: dict[str, Any] = {"timestep": 0.02, "solref": (-1e12, -1.0)}


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run where a log would be seen, with the engine told not to write one."""
    monkeypatch.chdir(tmp_path)
    silence_mujoco()


@pytest.fixture(scope="module")
def scene(make_scene: Callable[..., Scene]) -> Scene:
    manifest = (
        "pairs: [{geoms: [floor, ball], slots: 1}]\n"
        "initial: {speed: {default: -3, unit: m/s, description: s, sets: {ball.vz: speed}}}\n"
    )
    return make_scene(MODEL, manifest)


class Group:
    """Runs of one scene, whose models and start states a test may spoil before they start."""

    def __init__(self, scene: Scene, values: list[dict[str, Any]]) -> None:
        runs = [scene.resolve(each, 0, None) for each in values]
        self.base: CompiledScene = scene.base({})
        self.prepared: list[PreparedModel] = [self.base.prepare(run.list_edits()) for run in runs]
        self.starts: InitialStates = scene.initial_states(runs)

    def roll(self, buffers: Buffers | None = None) -> Rollout:
        models = [each.model for each in self.prepared]
        return roll_out(models, self.starts, STEPS, buffers or Buffers())


def test_a_diverging_run_is_cut_after_the_step_where_a_plain_loop_first_warns(
    scene: Scene, loop: Any
) -> None:
    group = Group(scene, [{}, EXPLODING, {}])
    rollout = group.roll()
    model = group.prepared[1].model
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = group.starts.qpos[1], group.starts.qvel[1]
    steps = 0
    while not any(data.warning[kind].number for kind in range(len(data.warning))):
        mujoco.mj_step(model, data)
        steps += 1
    # The step that warns is the last one made.
    assert rollout.steps == (STEPS, steps, STEPS)
    assert 0 < steps < STEPS
    assert rollout.warnings == ({}, {"badqacc": 1}, {})
    assert rollout.errors == (None, None, None)
    expected = loop(model, group.starts, 1, steps)
    assert np.array_equal(rollout.state[1, : steps + 1], expected.state)
    assert np.array_equal(rollout.sensors[1, :steps], expected.sensors)
    # It was not reset: it flies far off, while time has grown by one step a step.
    assert rollout.state[1, steps, 0] == pytest.approx(0.02 * steps)
    assert abs(rollout.state[1, steps, 3]) > 1e3


def test_the_trace_of_a_diverging_run_can_be_cut(scene: Scene) -> None:
    group = Group(scene, [{}, EXPLODING])
    rollout = group.roll()
    cut = make_trace(group.base, group.prepared, rollout).select([1], rollout.steps[1])
    assert cut.steps == rollout.steps[1]
    assert cut.qpos.shape[1] == cut.steps + 1
    assert cut.steps_asked == STEPS
    assert np.isfinite(cut.qpos).all()


def test_a_start_without_numbers_stops_at_once(scene: Scene) -> None:
    group = Group(scene, [{}, {}])
    group.starts.qpos[1, 2] = np.nan
    rollout = group.roll()
    assert rollout.steps[0] == STEPS
    assert rollout.steps[1] <= 1
    assert "badqpos" in rollout.warnings[1]
    make_trace(group.base, group.prepared, rollout)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda model: setattr(model.opt, "integrator", 99), "integrator"),
        (lambda model: model.geom_condim.fill(20), "condim"),
    ],
)
def test_an_error_of_mujoco_concerns_its_run_alone(
    spoil: Callable[[mujoco.MjModel], None], message: str, scene: Scene
) -> None:
    group = Group(scene, [{}, {}, {"cone": "elliptic"}])
    healthy = group.roll()
    spoil(group.prepared[1].model)
    # Memory full of what no run wrote must not show through.
    buffers = Buffers()
    arrays = buffers.arrays(group.prepared[0].model, 3, STEPS)
    arrays.state.fill(np.nan)
    arrays.sensors.fill(np.nan)
    arrays.iterations.fill(-1)
    rollout = group.roll(buffers)
    assert rollout.steps == (STEPS, 0, STEPS)
    assert rollout.errors[0] is rollout.errors[2] is None
    assert message in str(rollout.errors[1])
    # The message does not depend on the run's place in the group.
    assert "simulation" not in str(rollout.errors[1])
    for run in (0, 2):
        assert trajectory_hash(rollout, run) == trajectory_hash(healthy, run)
        assert np.array_equal(rollout.sensors[run], healthy.sensors[run])
    trace = make_trace(group.base, group.prepared, rollout)
    assert np.isfinite(trace.qpos).all()
    assert not trace.contacts[1].any()


def test_contacts_that_do_not_fit_stop_the_run(make_scene: Callable[..., Scene]) -> None:
    # So small an arena holds the bodies, but not the constraints of eight boxes on a floor.
    boxes = "".join(
        f'<body pos="{x} 0 .049"><freejoint/><geom type="box" size=".05 .05 .05"/></body>'
        for x in range(8)
    )
    model = f"""
    <mujoco><size memory="120K"/><option timestep="0.002"/>
      <worldbody><geom name="floor" type="plane" size="9 9 .1"/>{boxes}</worldbody></mujoco>"""
    group = Group(make_scene(model), [{}])
    rollout = group.roll()
    assert rollout.steps[0] < STEPS
    assert rollout.errors[0] or set(rollout.warnings[0]) & {"contactfull", "cnstrfull"}


def test_no_log_is_written(scene: Scene, tmp_path: Path) -> None:
    group = Group(scene, [EXPLODING])
    assert group.roll().warnings[0]
    assert list(tmp_path.iterdir()) == []


def test_each_run_is_watched_and_timed(scene: Scene) -> None:
    group = Group(scene, [{}, {}, {}])
    started: list[int] = []
    models = [each.model for each in group.prepared]
    rollout = roll_out(models, group.starts, STEPS, Buffers(), lambda: started.append(1))
    assert len(started) == 3
    assert (rollout.cost > 0).all()
