"""Integrating keeps few states of a rollout, and ends at any time exactly."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.engines import Buffers, single_run
from contactlab.engines.mujoco_batch import roll_out
from contactlab.engines.single_run import count_work, integrate_to
from contactlab.scene.scene import Scene

Make = Callable[..., Scene]
FALL = """
<mujoco>
  <option gravity="0 0 -10"/>
  <worldbody>
    <body name="ball" pos="0 0 100"><freejoint name="ball"/><geom size=".1"/></body>
  </worldbody>
</mujoco>
"""
PUSHED = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="box" pos="0 0 .06">
      <freejoint name="box"/><geom name="box" type="box" size=".05 .05 .05" mass="1"/>
    </body>
  </worldbody>
</mujoco>
"""
CONTROL = "pairs: [{geoms: [floor, box]}]\ncontrol: {box.fx: {at: [0, 0.1], to: [0, 20]}}\n"
STEPS = 100


@pytest.fixture(scope="module")
def pushed(make_scene: Make) -> Scene:
    return make_scene(PUSHED, CONTROL)


@pytest.mark.parametrize("block", [1, 1000, 4 << 20])
@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicitfast"])
def test_it_is_a_rollout_of_which_few_states_are_kept(
    pushed: Scene, block: int, integrator: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(single_run, "_BLOCK_BYTES", block)
    run = pushed.resolve({"integrator": integrator}, 1, None)
    start = pushed.initial_states([run])
    model = pushed.prepare(run, start).model
    rollout = roll_out([model], start, STEPS, Buffers())
    kept = np.array([1, 2, 50, 99, 100])
    found = integrate_to(model, start, kept * run.timestep)
    assert found is not None
    assert found.states.tobytes() == rollout.state[0, kept].tobytes()
    assert found.qpos.tobytes() == rollout.state[0, kept, 1:8].tobytes()
    assert found.qvel.tobytes() == rollout.state[0, kept, 8:14].tobytes()


@given(fraction=st.floats(0, 1), steps=st.integers(0, 20))
def test_it_reaches_times_between_steps_by_a_shorter_step(
    falling: Callable[[str], Any], fraction: float, steps: int
) -> None:
    """The semi-implicit rule: g (h^2 n (n+1)/2 + d n h + d^2) after n steps h and one of d.

    Positions of 100 m are rounded to 1.4e-14 m in each of 21 steps. A rest of less than a millionth
    of a step counts as none: it would fall by 1e-8 m at most.
    """
    model, start, timestep = falling("Euler")
    rest = fraction * timestep
    found = integrate_to(model, start, np.array([steps * timestep + rest]))
    assert found is not None
    fall = timestep**2 * steps * (steps + 1) / 2 + rest * steps * timestep + rest**2
    least = 3e-13 if 1e-5 < fraction < 1 - 1e-5 else 1e-7
    assert found.qpos[0, 2] == pytest.approx(100 - 10 * fall, abs=least)


@given(when=st.lists(st.floats(1e-3, 0.5), min_size=1, max_size=5).map(sorted))
def test_a_fourth_order_integration_is_on_the_parabola_at_any_time(
    falling: Callable[[str], Any], when: list[float]
) -> None:
    """RK4 is exact for it; what is snapped to a step is off by 1e-6 of it, 1e-8 s at 5 m/s."""
    model, start, _ = falling("RK4")
    times = np.array(when)
    found = integrate_to(model, start, times)
    assert found is not None
    assert found.qpos[:, 2] == pytest.approx(100 - 5 * times**2, abs=6e-8)


def test_it_restarts_from_a_given_state(pushed: Scene) -> None:
    """What drives the box goes by the clock of the whole run; friction is solved to 1e-8."""
    run = pushed.resolve({}, 1, None)
    start = pushed.initial_states([run])
    model = pushed.prepare(run, start).model
    times = np.array([40, 60, 100]) * run.timestep
    whole = integrate_to(model, start, times)
    assert whole is not None
    rest = integrate_to(model, start, times[1:], begin=float(times[0]), state=whole.states[0])
    assert rest is not None
    assert rest.states == pytest.approx(whole.states[1:], abs=1e-7)
    assert whole.qvel[2, 0] > 2 * whole.qvel[0, 0] > 0


def test_a_run_that_does_not_complete_has_no_states(make_scene: Make) -> None:
    scene = make_scene(FALL)
    run = scene.resolve({"gravity": 1e12}, 0, None)
    start = scene.initial_states([run])
    model = scene.prepare(run, start).model
    assert integrate_to(model, start, np.array([0.5])) is None
    assert count_work(model, start, 250) is None


def test_impacts_are_changes_of_the_number_of_contacts(pushed: Scene) -> None:
    run = pushed.resolve({}, 1, None)
    start = pushed.initial_states([run])
    prepared = pushed.prepare(run, start)
    layout = pushed.base_of(run).layout
    rollout = roll_out([prepared.model], start, STEPS, Buffers())
    contacts = rollout.sensors[0, :, layout.contacts].astype(int)
    found = integrate_to(prepared.model, start, np.array([STEPS * run.timestep]))
    assert found is not None
    assert found.impacts == np.count_nonzero(np.diff(contacts)) > 0


@pytest.fixture(scope="module")
def falling(make_scene: Make) -> Callable[[str], Any]:
    """Return a maker of a model, start and timestep of a ball in free fall."""
    scene = make_scene(FALL, "perturb: {coordinates: [ball.x], scale: 1.0e-3}\n")

    def make(integrator: str) -> Any:
        run = scene.resolve({"integrator": integrator, "timestep": 0.01}, 0, None)
        start = scene.initial_states([run])
        return scene.prepare(run, start).model, start, run.timestep

    return make
