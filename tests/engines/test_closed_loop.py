"""Policies: native steps between two calls are the steps of a plain loop that asks at each call."""

import math
import re
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.cart_pole import cart_pole

from contactlab.contact.trace_arrays import RecordedControls
from contactlab.engines import Buffers, PreparedRuns, Rollout, closed_loop
from contactlab.engines.mujoco_batch import roll_out
from contactlab.engines.mujoco_engine import MujocoEngine
from contactlab.scene.scene import Scene
from contactlab.schema.drive import PolicyDrive

STEPS = 120
CART_POLE = cart_pole(
    0.002,
    motor="{delay}",
    more="""<sensor>
    <jointvel name="turning" joint="hinge"/><framepos name="tip" objtype="geom" objname="pole"/>
    </sensor>""",
)
MANIFEST = """
pairs: [{geoms: [floor, cart]}]
initial:
  tilt: {default: 0.1, unit: rad, description: t, sets: {hinge: tilt}}
  wind: {default: 0.0, unit: N, description: w, sets: {pole.fx: wind}}
"""
Make = Callable[..., Scene]


class Feedback:
    """Feedback that stabilises the cart-pole, summed in one order for any number of runs."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.actuators = model.nu

    def __call__(self, *observed: np.ndarray) -> np.ndarray:
        _, qpos, qvel, _ = observed
        place, tilt = qpos.T
        speed, turning = qvel.T
        return (50.0 * tilt + 8.0 * turning + 2.0 * place + 4.0 * speed)[:, None]


def recorded(rollout: Rollout) -> list[RecordedControls]:
    """Return what the policy did in each run."""
    assert rollout.controls
    return [controls for controls in rollout.controls if controls is not None]


@pytest.fixture(scope="module")
def cart(make_scene: Make) -> Scene:
    return make_scene(CART_POLE.format(delay=""), MANIFEST)


def prepared(
    scene: Scene, drive: PolicyDrive, policy: Any, *values: dict[str, Any], steps: int = STEPS
) -> PreparedRuns:
    driven = scene.with_drive(drive, Path(__file__).parent)
    resolved = [driven.resolve(each, seed, None) for seed, each in enumerate(values)]
    return replace(PreparedRuns.of(driven, *resolved), steps=steps, policy=policy)


def flown(runs: PreparedRuns, **hooks: Any) -> Rollout:
    return MujocoEngine().roll_out(runs, Buffers(), **hooks)


def drive(**parts: Any) -> PolicyDrive:
    return PolicyDrive(policy="test_closed_loop.py:Feedback", **parts)


def looped(runs: PreparedRuns, run: int, every: int, delay: int) -> np.ndarray:
    """Step one run with mj_step, asking every so many steps."""
    model, starts = runs.models[run], runs.starts
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = starts.qpos[run], starts.qvel[run], starts.ctrl[run]
    data.xfrc_applied[:] = starts.applied[run].reshape(-1, 6)
    policy, wanted, rows = Feedback(model), {}, []
    for step in range(runs.steps):
        if step % every == 0:
            seen = np.array([data.time]), data.qpos[None], data.qvel[None], data.sensordata[None]
            wanted[step + delay] = policy(*seen)[0]
        if step in wanted:
            data.ctrl[:] = wanted[step]
        rows.append(np.concatenate([[data.time], data.qpos, data.qvel]))
        mujoco.mj_step(model, data)
    rows.append(np.concatenate([[data.time], data.qpos, data.qvel]))
    return np.array(rows)


@pytest.mark.parametrize(("rate", "every"), [(50.0, 10), (500.0, 1), (100.0, 5)])
@pytest.mark.parametrize(("latency", "delay"), [(0.0, 0), (0.02, 10), (0.003, 2), (0.05, 25)])
def test_a_policy_acts_as_in_a_plain_loop(
    cart: Scene, rate: float, every: int, latency: float, delay: int
) -> None:
    values = [{"tilt": 0.1}, {"tilt": -0.05}, {"wind": 2.0}]
    runs = prepared(cart, drive(rate=rate, latency=latency), Feedback, *values)
    rollout = flown(runs)
    assert rollout.steps == (STEPS,) * 3
    for run in range(3):
        assert rollout.state[run].tobytes() == looped(runs, run, every, delay).tobytes()


@settings(max_examples=20)
@given(
    rate=st.floats(3.0, 500.0),
    latency=st.floats(0.0, 0.1),
    noise=st.sampled_from([0.0, 1e-3]),
    tilts=st.lists(st.floats(-0.2, 0.2), min_size=1, max_size=5),
)
def test_a_run_repeats_from_its_controls_alone(
    cart: Scene, rate: float, latency: float, noise: float, tilts: list[float]
) -> None:
    spec = drive(rate=rate, latency=latency, noise={"qpos": noise, "qvel": noise})
    runs = prepared(cart, spec, Feedback, *({"tilt": tilt, "wind": 1.0} for tilt in tilts))
    rollout = flown(runs)
    starts = runs.starts.with_recorded_inputs(recorded(rollout))
    again = roll_out(runs.models, starts, STEPS, Buffers())
    assert again.state.tobytes() == rollout.state.tobytes()
    assert again.sensors.tobytes() == rollout.sensors.tobytes()
    assert again.iterations.tobytes() == rollout.iterations.tobytes()
    assert rollout.work is not None
    np.testing.assert_array_equal(again.work, rollout.work)
    np.testing.assert_array_equal(again.constraint_gain, rollout.constraint_gain)


def test_runs_of_a_job_are_what_each_is_alone(cart: Scene) -> None:
    spec = drive(rate=70.0, latency="50%", noise={"qpos": 1e-3, "qvel": 1e-2})
    runs = prepared(cart, spec, Feedback, *({"tilt": tilt} for tilt in (0.1, 0.0, -0.1, 0.05)))
    together = flown(runs)
    for run in range(4):
        state = together.state[run].copy()
        alone = flown(runs.rows([run]))
        assert alone.state[0].tobytes() == state.tobytes()
        assert recorded(alone)[0].sha256 == recorded(together)[run].sha256
        together = flown(runs)


def test_latency_is_a_delay_of_the_plant(make_scene: Make, cart: Scene) -> None:
    """A policy with latency L acts as one without on a plant whose actuator is L late.

    MuJoCo keeps the controls of a delayed actuator in a buffer, here held from one to the next.
    """
    delay = 0.016
    late = make_scene(CART_POLE.format(delay=f'delay="{delay}" nsample="9" interp="zoh"'), MANIFEST)
    values = [{"tilt": 0.1}, {"tilt": -0.08}]
    policy_late = flown(prepared(cart, drive(rate=100.0, latency=delay), Feedback, *values))
    states = policy_late.state.copy()
    plant_late = flown(prepared(late, drive(rate=100.0), Feedback, *values))
    assert np.abs(states).max() > 0.09
    assert plant_late.state.tobytes() == states.tobytes()


def test_a_policy_holds_an_unstable_pole(cart: Scene) -> None:
    values = [{"tilt": 0.1}, {"tilt": -0.1}]
    held = flown(prepared(cart, drive(rate=50.0), Feedback, *values, steps=4000))
    assert np.abs(held.state[:, -1, 1:]).max() < 0.01
    assert np.abs(held.state[:, :, 2]).max() < 0.2
    slow = flown(prepared(cart, drive(rate=50.0, latency=0.2), Feedback, *values, steps=2000))
    assert np.abs(slow.state[:, :, 2]).max() > math.pi / 2


@pytest.mark.long
def test_noise_has_the_stated_size_and_is_the_same_at_any_timestep(cart: Scene) -> None:
    seen: list[tuple[np.ndarray, ...]] = []

    class Watching(Feedback):
        def __call__(self, *observed: np.ndarray) -> np.ndarray:
            seen.append(observed)
            return super().__call__(*observed) * 0

    spec = drive(rate=50.0, noise={"qpos": 2e-3, "qvel": 3e-2})
    errors = []
    for timestep, steps in ((0.002, 20000), (0.004, 10000)):
        seen.clear()
        runs = prepared(cart, spec, Watching, {"timestep": timestep, "tilt": 0.0}, steps=steps)
        rollout = flown(runs)
        true = rollout.state[0, :: round(0.02 / timestep)][: len(seen)]
        errors.append(
            np.array([np.concatenate([each[1][0], each[2][0]]) for each in seen]) - true[:, 1:]
        )
    # 2,000 samples of a normal distribution have its deviation to within 1 / sqrt(2 * 2000), as one
    # standard error; five of them are 8 %.
    assert np.allclose(errors[0].std(axis=0), [2e-3, 2e-3, 3e-2, 3e-2], rtol=0.08)
    assert np.allclose(errors[0], errors[1], atol=1e-12)


STACK = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="low" pos="0 0 .05"><freejoint/><geom type="box" size=".05 .05 .05"/></body>
    <body name="top" pos="0 0 .15"><freejoint/><geom type="box" size=".05 .05 .05"/></body>
    <body name="arm" pos=".5 0 .5">
      <joint name="hinge" axis="0 1 0" damping=".1"/>
      <geom type="capsule" fromto="0 0 0 .2 0 0" size=".01"/>
    </body>
  </worldbody>
  <actuator><motor name="motor" joint="hinge"/></actuator>
</mujoco>
"""


@pytest.mark.parametrize("name", ["asleep", "mixed"])
def test_segments_are_one_rollout(name: str, mixed: Scene, make_scene: Make) -> None:
    """With constant controls, steps cut into segments are those of one open-loop rollout."""
    scene = make_scene(STACK) if name == "asleep" else mixed
    kinds = [{}, {"cone": "elliptic"}, {"gravity": (0, 0, -1)}]

    def still(_: mujoco.MjModel) -> Any:
        return lambda time, *_: np.full((len(time), 1), 0.3)

    values = [{"sleep": True}] * 2 if name == "asleep" else kinds
    runs = prepared(scene, drive(rate=37.0), still, *values, steps=600)
    cut = flown(runs)
    state, sensors, iterations = (part.copy() for part in (cut.state, cut.sensors, cut.iterations))
    constant = [
        replace(each, levels=np.full_like(each.levels, 0.3)) for each in runs.starts.signals
    ]
    starts = runs.starts._replace(signals=tuple(constant))
    whole = roll_out(runs.models, starts, 600, Buffers())
    assert cut.steps == whole.steps == (600,) * len(values)
    assert whole.state.tobytes() == state.tobytes()
    assert whole.sensors.tobytes() == sensors.tobytes()
    assert whole.iterations.tobytes() == iterations.tobytes()


def bad(answer: Callable[..., Any]) -> Any:
    """Return a policy that answers so."""

    class Bad(Feedback):
        def __call__(self, *observed: np.ndarray) -> Any:
            return answer(super().__call__(*observed), *observed)

    return Bad


def raises_late(wanted: np.ndarray, time: np.ndarray, *_: np.ndarray) -> np.ndarray:
    if time[0] > 0.11:
        raise ValueError("out of\nideas")
    return wanted


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (
            raises_late,
            r"policy Bad, at 0.12 s: line \d+ of test_closed_loop.py: ValueError: out of ideas",
        ),
        (lambda wanted, *_: wanted[:, 0], r"returned an array of shape \(\d,\); .* is \(\d, 1\)"),
        (lambda wanted, *_: wanted.astype(complex), "returned complex128; controls are real"),
        (lambda wanted, *_: [["left"]] * len(wanted), "returned <U4; controls are real"),
        (lambda *_: [[1.0], [1.0, 2.0]], "policy Bad, at 0 s: .*ValueError"),
        (lambda *_: sys.exit(3), "policy Bad, at 0 s: .*SystemExit: 3"),
        (
            lambda wanted, time, *_: np.where(time[:, None] < 0.1, wanted, np.nan),
            "returned nan for push at 0.1 s",
        ),
    ],
)
def test_a_bad_policy_costs_its_runs_alone(cart: Scene, answer: Any, message: str) -> None:
    runs = prepared(cart, drive(), bad(answer), {"tilt": 0.1}, {"tilt": -0.1})
    rollout = flown(runs)
    assert rollout.steps == (0, 0)
    assert rollout.controls == (None, None)
    for error in rollout.errors:
        assert error is not None
        assert "\n" not in error
        assert re.search(message, error)


def test_a_policy_that_fails_in_one_run_loses_no_other(cart: Scene) -> None:
    def refuses(wanted: np.ndarray, _: np.ndarray, qpos: np.ndarray, *__: np.ndarray) -> np.ndarray:
        if (qpos[:, 1] > 0.3).any():
            raise RuntimeError("too far")
        return wanted

    values = [{"tilt": 0.1}, {"tilt": 0.5}, {"tilt": -0.1}]
    rollout = flown(prepared(cart, drive(), bad(refuses), *values))
    state = rollout.state.copy()
    assert rollout.steps == (STEPS, 0, STEPS)
    expected = flown(prepared(cart, drive(), Feedback, *values))
    assert [error is None for error in rollout.errors] == [True, False, True]
    assert state[[0, 2]].tobytes() == expected.state[[0, 2]].tobytes()


def test_a_policy_that_cannot_be_made_says_so(cart: Scene) -> None:
    class Broken:
        def __init__(self, model: mujoco.MjModel) -> None:
            self.body = model.body("no such body")

    class Silent:
        def __init__(self, model: mujoco.MjModel) -> None: ...

    for policy, message in ((Broken, "KeyError"), (Silent, "give it a method __call__")):
        rollout = flown(prepared(cart, drive(), policy, {}, {}))
        assert all(message in str(error) for error in rollout.errors)


def test_a_rate_above_that_of_the_steps_is_refused(cart: Scene) -> None:
    rollout = flown(prepared(cart, drive(rate=501.0), Feedback, {}))
    assert rollout.errors[0] == (
        "the policy should act at 501 Hz, but steps of 0.002 s have a rate of 500 Hz; lower its "
        "rate, or the timestep"
    )


def test_costs_are_shares_of_what_all_steps_take(
    cart: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The steps of the second run take five times as long as those of the others."""
    flight_class: Any = vars(closed_loop)["_Flight"]
    step = flight_class._step_runs

    def taken(flight: Any, runs: list[int], begin: int, end: int) -> float:
        step(flight, runs, begin, end)
        return sum(5.0 if run == 1 else 1.0 for run in runs) * (end - begin)

    monkeypatch.setattr(flight_class, "_step_runs", taken)
    runs = prepared(cart, drive(rate=100.0), Feedback, {"tilt": 0.1}, {}, {"tilt": -0.1}, steps=100)
    assert flown(runs).cost == pytest.approx([100.0, 500.0, 100.0])
    assert flown(runs.rows([1])).cost == pytest.approx([100.0])
    values = [{"tilt": 0.1}, {"tilt": 0.1, "wind": 1e300}]
    stopped = flown(prepared(cart, drive(rate=100.0), Feedback, *values, steps=100))
    assert stopped.cost[0] > 5 * stopped.cost[1] > 0


def test_a_run_that_diverges_stops_by_itself(cart: Scene) -> None:
    values = [{"tilt": 0.1}, {"tilt": 0.1, "wind": 1e300}, {"tilt": -0.1}]
    runs = prepared(cart, drive(), Feedback, *values)
    rollout = flown(runs)
    state = rollout.state.copy()
    assert rollout.steps[0] == rollout.steps[2] == STEPS
    assert rollout.steps[1] < STEPS
    assert rollout.warnings[1]
    starts = runs.starts.with_recorded_inputs(recorded(rollout))
    again = roll_out(runs.models, starts, STEPS, Buffers())
    assert again.steps == rollout.steps
    assert again.state.tobytes() == state.tobytes()


def test_a_stop_leaves_the_first_run(cart: Scene) -> None:
    asked = iter([True, True, False])
    values = [{"tilt": 0.1}, {"tilt": -0.1}]
    runs = prepared(cart, drive(), Feedback, *values)
    rollout = flown(runs, proceed=lambda: next(asked))
    state = rollout.state.copy()
    assert rollout.steps == (STEPS,)
    assert state[0].tobytes() == flown(runs).state[0].tobytes()


@pytest.mark.parametrize("count", [1, 3, 20])
def test_each_run_has_its_time_limit(cart: Scene, count: int) -> None:
    """One is started for making the policy, before anything else, and one for each run."""
    calls: list[str] = []
    policy = bad(lambda wanted, *_: calls.append("act") or wanted)
    runs = prepared(cart, drive(), policy, *[{"tilt": 0.01}] * count)
    flown(runs, watch=lambda: calls.append("watch"))
    limits = [place for place, call in enumerate(calls) if call == "watch"]
    assert limits[0] == 0
    assert len(limits) == 1 + min(count, calls.count("act"))


def test_a_policy_gets_copies(cart: Scene) -> None:
    def spoils(wanted: np.ndarray, *observed: np.ndarray) -> np.ndarray:
        for each in observed:
            each[...] = 7.0
        return wanted

    runs = prepared(cart, drive(), bad(spoils), {"tilt": 0.1})
    state = flown(runs).state.copy()
    assert (
        state.tobytes() == flown(prepared(cart, drive(), Feedback, {"tilt": 0.1})).state.tobytes()
    )


def test_forces_of_the_scene_act_beside_a_policy(make_scene: Make) -> None:
    pushed = make_scene(
        CART_POLE.format(delay=""),
        MANIFEST + "control: {cart.fx: {at: [0, 0.1, 0.1], to: [0, 3, -2]}}\n",
    )
    runs = prepared(pushed, drive(latency=0.005), Feedback, {"tilt": 0.1}, {"tilt": -0.1})
    rollout = flown(runs)
    state = rollout.state.copy()
    starts = runs.starts.with_recorded_inputs(recorded(rollout))
    assert roll_out(runs.models, starts, STEPS, Buffers()).state.tobytes() == state.tobytes()
    calm = flown(prepared(pushed, drive(latency=0.005), Feedback, {"tilt": 0.1}, {"tilt": -0.1}))
    assert calm.state.tobytes() == state.tobytes()
    idle = [replace(each, levels=each.levels * 0) for each in runs.starts.signals]
    alone = runs.starts._replace(signals=tuple(idle))
    assert flown(replace(runs, starts=alone)).state.tobytes() != state.tobytes()


def test_sensors_are_those_of_the_last_step(cart: Scene) -> None:
    """The speed that a sensor measures is that at the start of the last step."""
    seen: list[tuple[np.ndarray, ...]] = []

    def watching(wanted: np.ndarray, *observed: np.ndarray) -> np.ndarray:
        seen.append(tuple(each.copy() for each in observed))
        return wanted

    rollout = flown(prepared(cart, drive(rate=50.0), bad(watching), {"tilt": 0.1}))
    assert {each[3].shape for each in seen} == {(1, 4)}
    before = [0, *range(9, STEPS - 1, 10)]
    assert [each[3][0, 0] for each in seen] == [rollout.state[0, step, 4] for step in before]
    off = 1e-4  # of a loop's start
    expected = [0.3 * math.sin(0.1), 0, 0.3 * math.cos(0.1)]
    assert seen[0][3][0, 1:] == pytest.approx(expected, abs=off)
