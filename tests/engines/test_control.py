"""Controls and forces that change over time: equal to a loop that looks them up at every step."""

import pickle
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.engines import Buffers, PreparedRuns
from contactlab.engines.impulse import ImpulseEngine
from contactlab.engines.mujoco_batch import roll_out
from contactlab.engines.mujoco_engine import MujocoEngine
from contactlab.engines.rollout_trace import make_trace
from contactlab.errors import SceneError
from contactlab.scene.initial_states import InitialStates
from contactlab.scene.scene import Scene

STEPS = 60
MODEL = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="box" pos="0 0 .05">
      <freejoint name="box"/><geom name="box" type="box" size=".05 .05 .05" mass="1"/>
    </body>
    <body name="arm" pos=".5 0 .5">
      <joint name="hinge" axis="0 1 0" damping=".1"/><geom name="arm" size=".02" mass=".1"/>
      <geom name="rod" type="capsule" fromto="0 0 0 .2 0 0" size=".01" mass=".1"/>
    </body>
    <body name="cart" pos="-.5 0 .5">
      <joint name="rail" type="slide" axis="1 0 0" damping="1"/><geom name="cart" size=".02"/>
    </body>
  </worldbody>
  <actuator>
    <motor name="turn" joint="hinge" ctrlrange="-1 1" ctrllimited="true"/>
    <position name="move" joint="rail" kp="100"/>
  </actuator>
</mujoco>
"""
Make = Callable[..., Scene]


def manifest(control: str, initial: str = "{}") -> str:
    return (
        f"subject: box\npairs: [{{geoms: [floor, box]}}]\ninitial: {initial}\ncontrol: {control}\n"
    )


def driven(make_scene: Make, control: str, initial: str = "{}") -> Scene:
    return make_scene(MODEL, manifest(control, initial))


def slow(
    model: mujoco.MjModel, start: InitialStates, lines: dict[str, Any], steps: int
) -> np.ndarray:
    """Step with np.interp at every step; `lines` are read here, and not by the scene."""
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = start.qpos[0], start.qvel[0]
    states: list[np.ndarray] = []
    for step in range(steps):
        now = step * model.opt.timestep
        for name, (at, to) in lines.items():
            item, part = name.split(".")
            if part == "ctrl":
                data.actuator(item).ctrl[0] = np.interp(now, at, to)
            else:
                place = ["fx", "fy", "fz", "tx", "ty", "tz"].index(part)
                data.body(item).xfrc_applied[place] = np.interp(now, at, to)
        mujoco.mj_step(model, data)
        states.append(np.concatenate([data.qpos, data.qvel]))
    return np.array(states)


numbers = st.floats(-5, 5, allow_subnormal=False)
times = st.floats(0, 0.3, allow_subnormal=False)
knot_lists = st.lists(st.tuples(times, numbers), min_size=1, max_size=5).map(sorted)
INPUTS = ["turn.ctrl", "move.ctrl", "box.fx", "box.tz", "cart.fx"]


@pytest.mark.night
@given(
    lines=st.dictionaries(st.sampled_from(INPUTS), knot_lists, min_size=1),
    timesteps=st.lists(st.sampled_from([5e-4, 1e-3, 2e-3, 3.7e-3]), min_size=1, max_size=3),
)
def test_any_timed_input_equals_a_plain_loop(
    lines: dict[str, list[tuple[float, float]]], timesteps: list[float], make_scene: Make
) -> None:
    knots = {name: ([t for t, _ in line], [v for _, v in line]) for name, line in lines.items()}
    entries = (f"{name}: {{at: {at}, to: {to}}}" for name, (at, to) in knots.items())
    scene = driven(make_scene, "{" + ", ".join(entries) + "}")
    runs = [scene.resolve({"timestep": each}, 0, None) for each in timesteps]
    starts = scene.initial_states(runs)
    models = [scene.base({}).prepare(run.list_edits()).model for run in runs]
    rollout = roll_out(models, starts, STEPS, Buffers())
    for run, model in enumerate(models):
        expected = slow(model, starts.select_run(run), knots, STEPS)
        found = rollout.state[run, 1:, 1 : 1 + model.nq + model.nv]
        assert found.tobytes() == np.ascontiguousarray(expected).tobytes()


def test_times_and_values_follow_the_runs_own_initial_values(make_scene: Make, roll: Any) -> None:
    scene = driven(
        make_scene,
        "{move.ctrl: {at: [0, close], to: [0.01, 2 * reach]}}",
        "{close: {default: 0.05, unit: s, description: c}, "
        "reach: {default: 0.1, unit: m, description: r}}",
    )
    rolled = roll(scene, [{}, {"close": 0.1, "reach": -0.2}], STEPS)
    rolled.assert_equals_loop(STEPS)
    assert [each.times.tolist() for each in rolled.starts.signals] == [[[0.0, 0.05]], [[0.0, 0.1]]]
    levels = [each.levels.tolist() for each in rolled.starts.signals]
    assert levels == [[[0.01, 0.2]], [[0.01, -0.4]]]
    assert rolled.starts.ctrl.tolist() == [[0.0, 0.01], [0.0, 0.01]]


def test_a_jump_takes_its_later_value(make_scene: Make) -> None:
    scene = driven(make_scene, "{turn.ctrl: {at: [0, 0.01, 0.01], to: [0, 0, 1]}}")
    starts = scene.initial_states([scene.resolve({}, 0, None)])
    found = starts.input_rows(0, 0.01 / 4, np.arange(6))[:, 0]
    assert found.tolist() == [0, 0, 0, 0, 1, 1]


def test_a_pattern_drives_several_inputs(make_scene: Make, roll: Any) -> None:
    scene = driven(make_scene, '{"*.ctrl": {at: [0, 0.1], to: [0, 1]}, box.fy: {at: [0], to: [2]}}')
    rolled = roll(scene, [{}], STEPS)
    rolled.assert_equals_loop(STEPS)
    assert rolled.starts.driven_inputs.shape == (3,)
    assert rolled.starts.applied[0].max() == 2


def test_what_is_not_driven_stays(make_scene: Make, roll: Any) -> None:
    scene = driven(
        make_scene,
        "{turn.ctrl: {at: [0, 0.1], to: [0, 1]}}",
        "{push: {default: 3.0, unit: N, description: p, sets: {box.fx: push, move.ctrl: push}}}",
    )
    rolled = roll(scene, [{}], STEPS)
    rolled.assert_equals_loop(STEPS)
    inputs = rolled.starts.input_rows(0, 2e-3, np.arange(STEPS))
    assert (inputs[:, 1] == 3).all()
    assert (inputs[:, 2 + 6] == 3).all()


def test_the_second_pass_sees_the_same_run(make_scene: Make, roll: Any) -> None:
    """It repeats bit for bit, and dense and sparse agree on the accelerations under the inputs."""
    scene = driven(
        make_scene, "{box.fx: {at: [0, 0.1], to: [0, 9]}, turn.ctrl: {at: [0], to: [1]}}"
    )
    rolled = roll(scene, [{}], STEPS)
    base = scene.base({})
    trace = make_trace(base, rolled.prepared, rolled.rollout)
    runs, mujoco = PreparedRuns.of(scene, scene.resolve({}, 0, None)), MujocoEngine()
    runs = replace(runs, steps=STEPS)
    checks = mujoco.check_runs(runs, trace)
    assert checks.repeats.all()
    (signals,) = rolled.starts.signals
    other = rolled.starts._replace(signals=(replace(signals, levels=signals.levels + 1),))
    assert not mujoco.check_runs(replace(runs, starts=other), trace).repeats.any()
    assert checks.jacobian.max() < 1e-6


def test_a_nudged_copy_is_driven_alike(make_scene: Make) -> None:
    scene = driven(make_scene, "{turn.ctrl: {at: [0, 0.1], to: [0, 1]}}")
    runs = [scene.resolve({}, seed, None) for seed in (0, 1)]
    starts = scene.initial_states(runs)
    copies = scene.nudged_states(starts, runs)
    assert not np.array_equal(copies.qpos, starts.qpos)
    assert pickle.dumps(copies[1:]) == pickle.dumps(starts[1:])


def test_timed_inputs_are_part_of_the_run_id(make_scene: Make) -> None:
    text = "{turn.ctrl: {at: [0, 0.1], to: [0, LAST]}}"
    ids = {
        scene.run_id(scene.resolve({}, 0, None))
        for scene in (driven(make_scene, text.replace("LAST", each)) for each in ("1", "2", "1"))
    }
    assert len(ids) == 2


def test_the_impulse_engine_refuses_external_forces(make_scene: Make) -> None:
    model = (
        '<mujoco><worldbody><geom name="floor" type="plane" size="1 1 .1"/><body name="ball" '
        'pos="0 0 1"><freejoint name="ball"/><geom name="ball" size=".05"/></body></worldbody>'
        "</mujoco>"
    )
    scene = make_scene(model, "control: {ball.fx: {at: [0, 1], to: [0, 1]}}\n")
    run = scene.resolve({}, 0, None)
    assert "no forces except gravity" in str(ImpulseEngine().refusal(scene, run))
    runs = PreparedRuns.of(scene, run)
    with pytest.raises(SceneError, match="no forces except gravity"):
        ImpulseEngine().roll_out(runs, Buffers())


@pytest.mark.parametrize(
    ("control", "initial", "message"),
    [
        ("{turn.ctrl: {at: [0, 1], to: [0]}}", "{}", "2 times and 1 values"),
        ("{turn.ctrl: {at: [], to: []}}", "{}", "at least 1 item"),
        ("{turns.ctrl: {at: [0], to: [0]}}", "{}", "no coordinate 'turns.ctrl'.*turn.ctrl"),
        ("{hinge: {at: [0], to: [0]}}", "{}", "'hinge' is part of the state.*ACTUATOR.ctrl"),
        ("{turn.ctrl: {at: [0], to: [speed]}}", "{}", "unknown speed"),
        ("{turn.ctrl: {at: [0], to: [3 +]}}", "{}", "control turn.ctrl sets its values to '3 \\+'"),
        ("{turn.ctrl: {at: [1, 0.5], to: [0, 1]}}", "{}", "times must not decrease.*1, 0.5 s"),
        ("{turn.ctrl: {at: [0], to: [.inf]}}", "{}", "finite|valid number"),
        (
            '{turn.ctrl: {at: [0], to: [0]}, "t*.ctrl": {at: [0], to: [1]}}',
            "{}",
            r"control t\*.ctrl: control turn.ctrl sets the same",
        ),
        (
            "{turn.ctrl: {at: [0], to: [0]}}",
            "{effort: {default: 1.0, unit: N, description: e, sets: {turn.ctrl: effort}}}",
            "initial value 'effort' sets the same",
        ),
    ],
)
def test_mistakes_say_what_and_where(
    control: str, initial: str, message: str, make_scene: Make
) -> None:
    with pytest.raises(SceneError, match=f"scene.yaml(.|\n)*{message}"):
        driven(make_scene, control, initial)


def test_a_runs_own_values_may_be_wrong(make_scene: Make) -> None:
    scene = driven(
        make_scene,
        "{turn.ctrl: {at: [0, 0.2, close], to: [0, 1, 1]}}",
        "{close: {default: 0.3, unit: s, description: c}}",
    )
    with pytest.raises(SceneError, match=r"0, 0\.2, 0\.1 s for"):
        scene.initial_states([scene.resolve({"close": 0.1}, 0, None)])
