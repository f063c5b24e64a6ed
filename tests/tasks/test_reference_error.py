"""Shares of changed models, against closed forms."""

import mujoco
import numpy as np
import pytest

from contactlab.budget import Motion
from contactlab.budget.motion import GRAVITY_AS_REAL, INTEGRATION
from contactlab.budget.restarts import build_reference_model, held_inputs
from contactlab.studies.search.configuration import Configuration
from contactlab.tasks.reference_error import SLACK_SHARE, TaskReference
from contactlab.tasks.task_clock import whole_run

FALL = """<mujoco><option timestep="0.002"/><worldbody>
<body name="ball"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""
SWING = """<mujoco><option timestep="0.002"/><worldbody><body name="arm" pos="0 0 2">
<joint axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 1 0 0"/></body></worldbody>
</mujoco>"""


def motion(text: str, seconds: float, seeds: int = 1) -> Motion:
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    start = np.empty(mujoco.mj_stateSize(model, INTEGRATION))
    mujoco.mj_getState(model, data, start, INTEGRATION)
    steps = round(seconds / model.opt.timestep)
    return Motion(model, np.tile(start, (seeds, 1)), np.empty((seeds, steps, 0)), name="whole")


def test_without_gravity_what_falls_is_apart_by_all_that_is_real() -> None:
    """A window's phantom impulse is g T, the real one that and its part that counts as standing."""
    falling = motion(FALL, 0.4)
    reference = TaskReference.run_references([falling], 2, 1)
    light = Configuration({"gravity": (0.0, 0.0, 0.0)}).apply_to(falling.model)
    apart = reference.estimate_error(light, 2)
    # The step of the fine motion is first order of the limit: 2 / (2 - 1) in `apart`.
    assert apart.error == pytest.approx(2 / (1 + GRAVITY_AS_REAL), rel=0.03)
    assert (apart.body, apart.phase) == ("ball", "whole")


@pytest.mark.parametrize("finer", [1, 4])
def test_positions_are_those_of_the_fine_motion_at_the_steps_of_the_run(finer: int) -> None:
    """After n fine steps h of a semi-implicit method, a ball fell by g h^2 n (n + 1) / 2."""
    falling = motion(FALL, 0.4, seeds=2)
    (phase,) = TaskReference.run_references([falling], finer, 1).phases
    heights = phase.positions[:, 2].reshape(2, -1)
    assert falling.steps <= heights.shape[1] <= falling.steps + 1, "with or without the end"
    h, steps = 0.002 / finer, finer * np.arange(heights.shape[1])
    fallen = -9.81 * h**2 * steps * (steps + 1) / 2
    assert heights == pytest.approx(np.tile(fallen, (2, 1)), rel=1e-9)


@pytest.mark.parametrize("every", [2, 3, 4])
def test_fewer_windows_count_the_first_once(every: int) -> None:
    """A throw is real once, in the first window; its fall is the same in each of them."""
    falling = motion(FALL, 0.4)
    first = mujoco.mj_stateSize(falling.model, mujoco.mjtState.mjSTATE_TIME) + falling.model.nq
    falling.starts[:, first] = 30.0  # m/s, along x
    light = Configuration({"gravity": (0.0, 0.0, 0.0)}).apply_to(falling.model)
    shares = [
        TaskReference.run_references([falling], 2, 1, each).estimate_error(light, 2).error
        for each in (1, every)
    ]
    # Of ten windows the last does not fit into the motion with its end: a tenth of the fall.
    assert shares[0] == pytest.approx(2 * 9.81 * 0.4 / (30 + 9.81 * 0.4), rel=0.15)
    assert shares[1] == pytest.approx(shares[0], rel=0.1)


@pytest.mark.parametrize("finer", [2, 8, 12])
def test_slack_is_a_time_however_fine_the_reference_is(finer: int) -> None:
    """With .9 g, a body has g (.1 T - .9 s) too little speed after T if a time s is forgiven."""
    falling = motion(FALL.replace("0.002", "0.01"), 0.4)
    reference = TaskReference.run_references([falling], finer, 1)
    light = Configuration({"gravity": (0.0, 0.0, -0.9 * 9.81)}).apply_to(falling.model)
    apart = reference.uncorrected_error(light, finer)
    missing = 0.1 - 0.9 * SLACK_SHARE
    assert apart.error == pytest.approx(missing / (1 + GRAVITY_AS_REAL), rel=0.03)


def test_models_of_equal_steps_forgive_no_time() -> None:
    """With .9 g, a body has .1 g T too little speed after T, whatever the step."""
    falling = motion(FALL.replace("0.002", "0.01"), 0.4)
    reference = TaskReference.run_references([falling], 1, 1)
    light = Configuration({"gravity": (0.0, 0.0, -0.9 * 9.81)}).apply_to(falling.model)
    same = reference.velocities_around(build_reference_model)
    apart = reference.error_against(lambda _: light, same)
    assert apart.error == pytest.approx(0.1 / (1 + GRAVITY_AS_REAL), rel=1e-6)


def test_the_model_itself_at_the_fine_step_is_not_apart() -> None:
    swinging = motion(SWING, 0.4, seeds=2)
    apart = TaskReference.run_references([swinging], 1, 1).estimate_error(swinging.model, 1)
    assert apart.error < 1e-12


def test_a_step_as_long_as_a_window_hides_no_error() -> None:
    """The error of Euler's method doubles with the step, up to 40 ms in windows of 40 ms."""
    swinging = motion(SWING, 1.6)
    reference = TaskReference.run_references([swinging], 2, 1)
    exact = TaskReference.run_references([swinging], 40, 1, integrator="RK4")
    shares = [reference.estimate_error(swinging.model, 2 * rate).error for rate in (5, 10, 20)]
    assert shares[1] / shares[0] == pytest.approx(2, rel=0.3)
    assert shares[2] / shares[1] == pytest.approx(2, rel=0.3)
    # A finer reference, of another method, says the same.
    assert exact.estimate_error(swinging.model, 800).error == pytest.approx(shares[2], rel=0.1)


def test_errors_grow_with_the_step_as_the_order_of_the_method_says() -> None:
    swinging = motion(SWING, 0.8)
    reference = TaskReference.run_references([swinging], 4, 1)
    shares = [reference.estimate_error(swinging.model, multiple).error for multiple in (8, 16)]
    assert shares[1] / shares[0] == pytest.approx(2, rel=0.35)
    smooth = Configuration({"integrator": "RK4"}).apply_to(swinging.model)
    fine = TaskReference.run_references(
        [motion(SWING.replace("<option", '<option integrator="RK4"'), 0.8)], 4, 1
    )
    assert fine.estimate_error(smooth, 8).error < 1e-6
    # Nothing of first order is left in that motion: shares are as steps, up to the second order.
    euler = Configuration({"integrator": "Euler"}).apply_to(swinging.model)
    shares = [fine.estimate_error(euler, multiple).error for multiple in (2, 8)]
    assert shares[1] / shares[0] == pytest.approx(4, rel=0.1)


def test_inputs_of_a_longer_step_are_the_mean_of_those_that_it_covers() -> None:
    model = mujoco.MjModel.from_xml_string(
        SWING.replace(
            "</worldbody>", "</worldbody><actuator><motor joint='j'/></actuator>"
        ).replace("<joint ", "<joint name='j' ")
    )
    start = np.empty((1, mujoco.mj_stateSize(model, INTEGRATION)))
    mujoco.mj_getState(model, mujoco.MjData(model), start[0], INTEGRATION)
    inputs = np.random.default_rng(0).normal(size=(1, 100, 1))
    moved = Motion(model, start, inputs)
    given = held_inputs(moved, 2, np.array([0]), np.array([40]), 6, 4)
    assert given[0, :, 0] == pytest.approx(inputs[0, 20:32, 0].reshape(4, 3).mean(axis=1))
    # A whole run takes every input once: 100 steps are 200 fine ones, or 50 of four.
    whole = whole_run(moved, 2, 0, 4)
    assert whole.steps == 50
    assert whole.inputs[0, :, 0] == pytest.approx(inputs[0, :, 0].reshape(50, 2).mean(axis=1))
