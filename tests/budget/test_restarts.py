"""Tests of restarts: windows cover a run once, inputs are held as long, and scales are impulses."""

import mujoco
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from contactlab.budget.motion import INTEGRATION, Motion
from contactlab.budget.restarts import (
    held_inputs,
    refine_motion,
    scale_of_impulses,
    subsample_windows,
    whole_windows,
)
from contactlab.budget.windows import replay_motion

PUSHED = """<mujoco><worldbody><body><joint name="x" type="slide"/><geom size=".1"/></body>
</worldbody><actuator><motor joint="x"/></actuator></mujoco>"""


def pushed(steps: int) -> Motion:
    """Return a motion of one seed whose input is the number of the step."""
    model = mujoco.MjModel.from_xml_string(PUSHED)
    start = np.empty((1, mujoco.mj_stateSize(model, INTEGRATION)))
    mujoco.mj_getState(model, mujoco.MjData(model), start[0], INTEGRATION)
    return Motion(model, start, np.arange(float(steps)).reshape(1, steps, 1), name="pushed")


@given(st.integers(5, 60), st.integers(1, 20))
def test_whole_windows_cover_each_step_at_most_once(steps: int, length: int) -> None:
    run = replay_motion(pushed(steps), length * 0.002, 1)
    whole = run.begins[whole_windows(run)]
    assert whole.tolist() == [*range(0, steps - run.steps + 1, run.steps)]


@given(st.integers(1, 30), st.integers(1, 6))
def test_a_refined_motion_has_the_same_inputs_on_the_mean(steps: int, rate: int) -> None:
    """Held by finer steps, and their mean taken again over as many, they are as before."""
    motion = pushed(steps)
    fine = refine_motion(motion, motion.model, rate)
    assert fine.steps == rate * steps
    again = held_inputs(motion, rate, np.array([0]), np.array([0]), rate, steps)
    assert again.tolist() == motion.inputs.tolist()


@given(st.integers(1, 40), st.integers(1, 8))
def test_sampled_windows_stand_for_all(count: int, every: int) -> None:
    windows, stood_for = subsample_windows(np.arange(count), every)
    assert windows[0] == 0
    assert stood_for[0] == 1
    if len(windows) > 1:
        assert abs(stood_for.sum() - count) < 1e-9 * count
    if every == 1:
        assert windows.tolist() == [*range(count)]


@given(st.lists(st.floats(0, 1e6), min_size=1, max_size=5))
def test_a_scale_is_the_real_impulse_unless_a_body_stands(impulses: list[float]) -> None:
    real = np.array([impulses])
    scale = scale_of_impulses(real)
    assert (scale > 0).all()
    moved = real >= 1e-6 * real.max()
    assert (scale[moved] == real[moved] + 1e-300).all()
    assert (scale >= 1e-6 * real.max()).all()
