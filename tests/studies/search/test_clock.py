"""Times of models in turns: the least of each piece, and intervals by turns and by seeds."""

import math
import time

import mujoco
import numpy as np
import pytest

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.schema.time_ratio import TimeRatio
from contactlab.studies.search import clock as timing
from contactlab.studies.search.clock import (
    Clock,
    InterleavedTimer,
    Segment,
    TimedModel,
    ratio_over_seeds,
    ratio_over_turns,
)
from contactlab.studies.search.report_text import time_ratio_text
from contactlab.tasks.reference_error import TaskReference

SWING = """<mujoco><option timestep="0.002"/><worldbody><body><joint axis="0 1 0"/>
<geom type="capsule" size=".02" fromto="0 0 0 1 0 0"/></body></worldbody></mujoco>"""


def test_seeds_count_by_the_time_that_they_take() -> None:
    """One seed takes 3 s and then a quarter of that, one takes 1 s and stays: 1.75 s of 4."""
    price = ratio_over_seeds(np.array([3.0, 1.0]), np.array([0.75, 1.0]))
    assert abs(price.ratio - 1.75 / 4) < 1e-15
    # Residuals of -/+ 0.5625 s have a standard error of 0.5625 x sqrt(2 x 2) / 4 = 0.28 by two
    # seeds, whose quantile is 12.7: two that differ by so much tell next to nothing.
    half = 12.706 * math.sqrt(2 * 2 * 0.5625**2) / (4 * price.ratio)
    assert abs(math.log(price.high / price.ratio) - half) < 1e-3
    assert abs(math.log(price.ratio / price.low) - half) < 1e-3


def test_seeds_that_agree_leave_nothing_open() -> None:
    base = np.array([1.0, 5.0, 2.0])
    price = ratio_over_seeds(base, 0.25 * base)
    assert abs(price.ratio - 0.25) < 1e-15
    assert price.half_width < 1e-12


def test_what_disturbs_a_piece_in_some_turns_disturbs_no_ratio() -> None:
    """Other work doubles each piece of a run in a third of its turns, and only adds.

    In all of nine turns it does so once in 3^9 = 20,000 pieces, of which there are 60.
    """
    generator = np.random.default_rng(1)

    def elapsed(whole: float, pieces: int) -> np.ndarray:
        return whole / pieces * (1 + (generator.random((9, pieces)) < 1 / 3))

    price = ratio_over_turns(elapsed(1.0, 50), elapsed(0.1, 10))
    assert abs(price.ratio - 0.1) < 1e-12
    # Of nine turns drawn again, all are the same few now and then: 1 / 3 of seven, say.
    assert price.low <= 0.1 <= price.high
    assert price.half_width < 0.05


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
    (price,) = clock.time_whole_runs([(motion.model, 2)], [[motion]], -math.inf)
    assert 0 < price.low <= price.ratio <= price.high < math.inf


class _Machine:
    """Turns of seeds of one model and of another, whose times are known but for noise.

    What a seed takes of one is distributed as a logarithmic normal of some width, and what it takes
    of the other beside that likewise, half in the mean. Other work doubles a third of the pieces.
    """

    def __init__(self, width: float, spread: float, tries: int) -> None:
        self._random, self.begun = np.random.default_rng(tries), 0
        self._width, self._spread = width, spread
        self._whole = list[float]()

    def turn(self, *_: object) -> "_Machine":
        """Return the turns of another seed."""
        self.begun += 1
        wide, apart = (
            math.exp(sigma * self._random.normal() - sigma**2 / 2)
            for sigma in (self._width, self._spread)
        )
        self._whole = [wide, 0.5 * wide * apart]
        return self

    def elapsed(self) -> list[np.ndarray]:
        """Return the times of 20 pieces of the one, and of 10 of the other."""
        return [
            whole / pieces * (1 + (self._random.random(pieces) < 1 / 3))
            for whole, pieces in zip(self._whole, (20, 10), strict=True)
        ]


@pytest.mark.parametrize(("width", "spread"), [(0.0, 0.0), (0.1, 0.05), (0.2, 0.1)])
def test_told_intervals_have_the_truth_in_nineteen_of_twenty(
    width: float, spread: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 300 tries each, 95 % have 0.5, or three standard errors of sqrt(.95 .05 / 300) less.

    Those who stop as soon as an interval is narrow stop at too narrow ones more often: 2 % fewer.
    """
    clock, motion = _clock(3, 4)
    tries = [_Machine(width, spread, number) for number in range(300)]
    prices = list[TimeRatio]()
    for machine in tries:
        monkeypatch.setattr(clock, "_whole_run_timer", machine.turn)
        prices += clock.time_whole_runs([(motion.model, 2)], [[motion]] * 8, math.inf)
    assert all(price.low <= price.ratio <= price.high for price in prices)
    within = np.mean([price.low <= 0.5 <= price.high for price in prices])
    assert 0.95 - 0.02 - 3 * math.sqrt(0.95 * 0.05 / 300) < within < 1.0
    # Where seeds differ, more of them are run, until half the interval is as narrow as wanted.
    narrow = [price.half_width <= timing.MAX_HALF_WIDTH for price in prices]
    assert all(one or machine.begun == 24 for one, machine in zip(narrow, tries, strict=True))


def test_ratios_of_times_are_printed_with_two_digits() -> None:
    assert time_ratio_text(TimeRatio.of(0.0183, 0.0179, 0.0191)) == "x0.018 (0.018 to 0.019)"
    assert time_ratio_text(TimeRatio.of(0.95, 0.9, 1.0)) == "x0.95 (0.90 to 1.00)"


class _Disturbed:
    """A clock of steps that take so long each, or twice as long half of the time, by spells."""

    def __init__(self) -> None:
        self.now = 0.0
        self._spells = np.random.default_rng(0).uniform(1e-3, 3e-3, 10_000).cumsum()

    def step(self, model: mujoco.MjModel, _: mujoco.MjData) -> None:
        """Take the time of a step, which is a tenth of what it simulates."""
        slow = np.searchsorted(self._spells, self.now) % 2
        self.now += 0.1 * model.opt.timestep * (1 + slow)


def test_what_slows_a_machine_down_at_times_favours_no_fast_model(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One model takes 20 ms, another 0.2; each of their pieces is left alone as likely.

    A piece is slow in both turns a quarter of the time. If that were so of the slow model alone,
    the ratio would be 0.8 of the right one. The mean over 20 tries of 10 copies has a standard
    error of sqrt(3 / 16 / 10 / 20) / 1.25 = 0.025.
    """
    machine, found = _Disturbed(), list[float]()
    monkeypatch.setattr(mujoco, "mj_step", machine.step)
    monkeypatch.setattr(time, "thread_time", lambda: machine.now)
    start = np.zeros((1, mujoco.mj_stateSize(mujoco.MjModel.from_xml_string(SWING), INTEGRATION)))
    stretch = Segment(start, np.empty((1, 101, 0)), 0, 101)
    for _ in range(20):
        timed = list[TimedModel]()
        for step in (2e-3, 2e-5):
            model = mujoco.MjModel.from_xml_string(SWING)
            model.opt.timestep = step
            timed.append(TimedModel(model, [stretch]))
        turn = InterleavedTimer(timed)
        turns = [turn.elapsed(), turn.elapsed()]
        slow, fast = (
            np.minimum(*each).sum() * one.simulated
            for each, one in zip(zip(*turns, strict=True), timed, strict=True)
        )
        found.append(fast / slow)
    assert abs(np.mean(found) / 0.01 - 1) < 0.08


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
