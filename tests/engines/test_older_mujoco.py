"""The loop in Python gives what MuJoCo's batch gives, bit for bit; so do slots without sensors."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import mujoco
import numpy as np
import pytest

from contactlab import resources
from contactlab.contact.trace_arrays import Trace
from contactlab.engines import Buffers, PreparedRuns, Rollout, mujoco_batch
from contactlab.engines.mujoco_batch import roll_out
from contactlab.engines.mujoco_engine import OlderMujocoEngine
from contactlab.engines.older_mujoco import StepLoop
from contactlab.engines.rollout_trace import make_trace
from contactlab.engines.single_run import count_work, integrate_to
from contactlab.scene.compiled_scene import CompiledScene, PreparedModel
from contactlab.scene.initial_states import InitialStates
from contactlab.scene.mujoco_versions import has_batch
from contactlab.scene.scene import Scene
from contactlab.scene.timed_inputs import Signals
from contactlab.store.control_tables import read_control_table

pytestmark = pytest.mark.skipif(not has_batch(), reason="needs a batch: MuJoCo 3.17 or newer")

STEPS = 120
EXPLODING: dict[str, Any] = {"timestep": 0.02, "solref": (-1e12, -1.0)}
# Everything that decides when a sensor is computed, or what it sees.
SETTINGS: list[dict[str, Any]] = [
    {"integrator": "Euler"},
    {"integrator": "RK4"},
    {"integrator": "implicit"},
    {"integrator": "implicitfast", "cone": "elliptic", "condim": 6},
    {"margin": 0.01, "gap": 0.005, "solver": "PGS", "noslip_iterations": 3},
    {"solver": "CG", "jacobian": "sparse", "gravity": (1.0, 0.5, -9.0)},
]


class Seen(NamedTuple):
    """Runs of a scene, and what came of them."""

    base: CompiledScene
    prepared: list[PreparedModel]
    starts: InitialStates
    rollout: Rollout
    trace: Trace


@pytest.fixture
def by_loop(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """Step by the loop from now on."""
    monkeypatch.setattr(mujoco_batch, "Batch", StepLoop)
    monkeypatch.setenv("CONTACTLAB_KERNEL", "off")
    return monkeypatch


@pytest.fixture
def without_sensors(by_loop: pytest.MonkeyPatch) -> None:
    """Have neither batch nor contact sensors from now on."""
    by_loop.setattr("contactlab.scene.compile_model.has_batch", lambda: False)


def see(name: str, values: Sequence[dict[str, Any]], steps: int = STEPS) -> Seen:
    scene = Scene.open(name, tables=read_control_table)
    runs = [scene.resolve(each, seed, None) for seed, each in enumerate(values)]
    base = scene.base(runs[0].structure)
    prepared = [base.prepare(run.list_edits()) for run in runs]
    starts = scene.initial_states(runs)
    rollout = roll_out([each.model for each in prepared], starts, steps, Buffers())
    return Seen(base, prepared, starts, rollout, make_trace(base, prepared, rollout))


def assert_same(batch: Rollout, loop: Rollout) -> None:
    """Compare all that was recorded, as bytes, up to where each run stopped."""
    assert loop.steps == batch.steps
    assert loop.warnings == batch.warnings
    assert loop.errors == batch.errors
    for run, steps in enumerate(batch.steps):
        for name, rows in (("state", steps + 1), ("sensors", steps), ("iterations", steps)):
            seen, expected = (getattr(each, name)[run, :rows] for each in (loop, batch))
            assert seen.tobytes() == expected.tobytes(), (run, name)


@pytest.fixture(scope="module")
def batches() -> dict[str, Rollout]:
    """What the batch records of every shipped scene, before anything is replaced."""
    return {
        name: see(name, [{}, {"integrator": "RK4"}]).rollout for name in resources.scene_names()
    }


@pytest.mark.long
@pytest.mark.parametrize("name", ["ball_drop", "box_stack", "grasp_mug", "mug_drop"])
def test_settings(name: str, request: pytest.FixtureRequest) -> None:
    batch = see(name, SETTINGS).rollout
    request.getfixturevalue("by_loop")
    assert_same(batch, see(name, SETTINGS).rollout)


@pytest.mark.night
@pytest.mark.parametrize("name", resources.scene_names())
def test_every_scene_without_contact_sensors(
    name: str, batches: dict[str, Rollout], request: pytest.FixtureRequest
) -> None:
    request.getfixturevalue("without_sensors")
    assert_same(batches[name], see(name, [{}, {"integrator": "RK4"}]).rollout)


@pytest.mark.long
@pytest.mark.parametrize("name", ["box_stack", "mug_drop"])
def test_settings_without_contact_sensors(name: str, request: pytest.FixtureRequest) -> None:
    # After a fall of 0.2 s, the mug meets fingers that it comes second to.
    batch = see(name, SETTINGS, 200).rollout
    request.getfixturevalue("without_sensors")
    loop = see(name, SETTINGS, 200)
    assert (loop.base.model.sensor_type == mujoco.mjtSensor.mjSENS_USER).any()
    assert any(pair.slots[..., 0].any() for pair in loop.trace.pairs)
    assert_same(batch, loop.rollout)


@pytest.mark.long
def test_slots_of_sleeping_bodies_stay(request: pytest.FixtureRequest) -> None:
    quick = [{"boxes": 2, "solref": (0.005, 1.0), "sleep": True}]
    batch = see("box_stack", quick, 400)
    assert not batch.rollout.state[0, -1, -12:].any()
    assert batch.trace.pairs[0].slots[0, -1, 0, 0] > 0
    request.getfixturevalue("without_sensors")
    assert_same(batch.rollout, see("box_stack", quick, 400).rollout)


@pytest.mark.long
def test_a_run_that_diverges(request: pytest.FixtureRequest) -> None:
    values = [{}, EXPLODING, {}]
    batch = see("ball_drop", values, 300).rollout
    assert 0 < batch.steps[1] < 300
    assert batch.warnings[1]
    request.getfixturevalue("by_loop")
    assert_same(batch, see("ball_drop", values, 300).rollout)


@pytest.mark.long
def test_a_run_that_the_engine_refuses(request: pytest.FixtureRequest) -> None:
    seen = see("ball_drop", [{}, {}], 20)
    models = [each.model for each in seen.prepared]
    models[1].opt.integrator = 99
    batch = roll_out(models, seen.starts, 20, Buffers())
    assert batch.errors[0] is None
    assert "integrator" in str(batch.errors[1])
    request.getfixturevalue("by_loop")
    loop = roll_out(models, seen.starts, 20, Buffers())
    assert_same(batch, loop)
    assert (loop.state[1] == loop.state[1, 0]).all()


@pytest.mark.long
def test_inputs_that_change(request: pytest.FixtureRequest) -> None:
    batch = see("gripping_pad", [{}, {"integrator": "RK4"}]).rollout
    request.getfixturevalue("by_loop")
    assert_same(batch, see("gripping_pad", [{}, {"integrator": "RK4"}]).rollout)


@pytest.mark.long
def test_integrating_and_counting(request: pytest.FixtureRequest) -> None:
    seen = see("box_stack", [{}], 1)
    model, start = seen.prepared[0].model, seen.starts.select_run(0)
    times = np.array([0.0, 0.0113, 0.05, 0.2])

    def both() -> tuple[Any, Any]:
        return integrate_to(model, start, times), count_work(model, start, STEPS)

    integrated, counted = both()
    request.getfixturevalue("by_loop")
    again, recounted = both()
    assert again.states.tobytes() == integrated.states.tobytes()
    assert again.impacts == integrated.impacts
    assert recounted[:5] == counted[:5]
    assert recounted.states.tobytes() == counted.states.tobytes()


@pytest.mark.long
@pytest.mark.usefixtures("by_loop")
def test_cost_is_that_of_native_steps() -> None:
    engine, scene = OlderMujocoEngine(), Scene.open("ball_drop")
    runs = replace(PreparedRuns.of(scene, scene.resolve({}, 0, None)), steps=500)
    assert (engine.roll_out(runs, Buffers()).cost > 0).all()
    assert engine.null_fields(driven=False) == {}
    signals = Signals(np.zeros(1, np.intp), np.zeros((1, 1)), np.zeros((1, 1)))
    starts = runs.starts._replace(signals=(signals,))
    driven = replace(runs, starts=starts, steps=10)
    assert np.isnan(engine.roll_out(driven, Buffers()).cost).all()
    assert list(engine.null_fields(driven=True)) == ["cost"]


@pytest.mark.long
@pytest.mark.usefixtures("without_sensors")
def test_the_callback_does_not_outlive_its_run() -> None:
    see("ball_drop", [{}], 5)
    assert mujoco.get_mjcb_sensor() is None
