"""Times of models on the motion of a task, and ratios of the times of seeds."""

import copy
import math

import mujoco
import numpy as np
import pytest

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.schema.time_ratio import TimeRatio
from contactlab.tasks.reference_error import TaskReference
from contactlab.tasks.task_clock import Clock, Segment, TimedModel

SWING = """<mujoco><option timestep="0.002"/><worldbody><body><joint axis="0 1 0"/>
<geom type="capsule" size=".02" fromto="0 0 0 1 0 0"/></body></worldbody></mujoco>"""


def test_seeds_count_by_the_time_that_they_take() -> None:
    """One seed takes 3 s and then a quarter of that, one takes 1 s and stays: 1.75 s of 4."""
    price = TimeRatio.of_sums([3.0, 1.0], [0.75, 1.0])
    assert abs(price.ratio - 1.75 / 4) < 1e-15
    # Residuals of -/+ 0.5625 s have a standard error of 0.5625 x sqrt(2 x 2) / 4 = 0.28 by two
    # seeds, whose quantile is 12.7: two that differ by so much tell next to nothing.
    half = 12.706 * math.sqrt(2 * 2 * 0.5625**2) / (4 * price.ratio)
    assert abs(math.log(price.high / price.ratio) - half) < 1e-3
    assert abs(math.log(price.ratio / price.low) - half) < 1e-3


def test_seeds_that_agree_leave_nothing_open() -> None:
    base = [1.0, 5.0, 2.0]
    price = TimeRatio.of_sums(base, [0.25 * each for each in base])
    assert abs(price.ratio - 0.25) < 1e-15
    assert price.half_width < 1e-12


def _clock(seeds: int, steps: int) -> tuple[Clock, Motion]:
    """Return a clock of a swing, and its motion of so many seeds."""
    model = mujoco.MjModel.from_xml_string(SWING)
    start = np.empty((seeds, mujoco.mj_stateSize(model, INTEGRATION)))
    for row in start:
        mujoco.mj_getState(model, mujoco.MjData(model), row, INTEGRATION)
    motion = Motion(model, start, np.empty((seeds, steps, 0)), name="whole")
    return Clock(TaskReference.run_references([motion], 2, 1), model), motion


def test_whole_runs_are_timed_by_two_seeds_at_least() -> None:
    """A model beside itself: one seed would not tell how seeds differ, however short the time."""
    clock, motion = _clock(3, 40)
    (price,) = clock.time_whole_runs([(motion.model, 2)], [[motion]], lambda: False)
    assert 0 < price.low <= price.ratio <= price.high < math.inf


def test_counted_costs_follow_the_work_of_a_step() -> None:
    clock, motion = _clock(2, 40)
    stages = copy.copy(motion.model)
    stages.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    same, half, dear = clock.count_costs([(motion.model, 2), (motion.model, 1), (stages, 2)])
    assert same == 1.0
    assert half == pytest.approx(2.0, rel=1e-6)
    assert 2 < dear < 4


def test_ratios_of_times_are_printed_with_two_digits() -> None:
    assert TimeRatio.of(0.0183, 0.0179, 0.0191).text == "x0.018 (0.018 to 0.019)"
    assert TimeRatio.of(0.95, 0.9, 1.0).text == "x0.95 (0.90 to 1.00)"


def test_the_first_step_of_a_segment_is_not_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its caches are those of another model: here it takes a second, and the others 1 ms."""
    model = mujoco.MjModel.from_xml_string(SWING)
    now, steps = 0.0, 0

    def step(*_: object) -> None:
        nonlocal now, steps
        now += 1e-3 if steps % 11 else 1.0
        steps += 1

    monkeypatch.setattr(mujoco, "mj_step", step)
    monkeypatch.setattr("time.thread_time", lambda: now)
    starts = np.zeros((2, mujoco.mj_stateSize(model, INTEGRATION)))
    timed = TimedModel(model, [Segment(starts, np.empty((2, 11, 0)), 0, 11)])
    assert timed.measure_cost() == pytest.approx(1e-3 / 0.002)
    assert steps == 22


def test_a_model_that_the_engine_refuses_takes_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise mujoco.FatalError("no")

    clock, motion = _clock(2, 40)
    monkeypatch.setattr(mujoco, "mj_step", refuse)
    starts = np.zeros((1, mujoco.mj_stateSize(motion.model, INTEGRATION)))
    assert (
        TimedModel(motion.model, [Segment(starts, np.empty((1, 3, 0)), 0, 3)]).measure_cost()
        == math.inf
    )
    assert clock.base_seconds > 0


def test_a_model_that_gives_up_is_timed_as_a_loop_goes_on() -> None:
    """What records runs forbids MuJoCo to reset itself: a loop has its resets, and no NaN."""
    model = mujoco.MjModel.from_xml_string(SWING)
    start = np.empty((1, mujoco.mj_stateSize(model, INTEGRATION)))
    mujoco.mj_getState(model, mujoco.MjData(model), start[0], INTEGRATION)
    recorded = mujoco.MjModel.from_xml_string(SWING)
    recorded.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    motion = Motion(model, start, np.empty((1, 40, 0)), name="whole")
    clock = Clock(TaskReference.run_references([motion], 2, 1), recorded)
    clock.time_ratios([(recorded, 2)])
    assert not recorded.opt.disableflags
