"""Times of models in turns: the least of each piece, and intervals by resampling."""

import math
import time
from functools import partial

import mujoco
import numpy as np
import pytest

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.budget.prices import Price
from contactlab.studies.search import clock as timing
from contactlab.studies.search.clock import (
    Batches,
    Clock,
    Stretch,
    Timed,
    Turn,
    half_width,
    over_seeds,
)
from contactlab.studies.search.wording import is_faster, price_text
from contactlab.studies.search.yardstick import Yardsticks

SWING = """<mujoco><option timestep="0.002"/><worldbody><body><joint axis="0 1 0"/>
<geom type="capsule" size=".02" fromto="0 0 0 1 0 0"/></body></worldbody></mujoco>"""


def test_seeds_count_by_the_time_that_they_take() -> None:
    """One seed takes 3 s and is halved, one takes 1 s and stays: 2.5 s of 4 s."""
    base, model = [np.full((3, 1), 3.0), np.ones((3, 1))], [np.full((3, 2), 0.75), np.ones((3, 1))]
    price = over_seeds(base, model)
    assert price.ratio == 2.5 / 4
    # Drawn seeds may all be the one or all the other, a quarter of the draws each.
    assert (price.low, price.high) == (0.5, 1.0)
    # Of these seeds nothing is left to learn, whose turns agree.
    assert over_seeds(base, model, seeds=False) == (2.5 / 4,) * 3


def test_what_disturbs_a_piece_in_some_turns_disturbs_no_ratio() -> None:
    """Other work doubles each piece of a run in a third of its turns, and only adds.

    In all of nine turns it does so once in 3^9 = 20,000 pieces, of which there are 60 of each seed.
    """
    generator = np.random.default_rng(1)

    def taken(whole: float, pieces: int) -> list[np.ndarray]:
        slow = generator.random((6, 9, pieces)) < 1 / 3
        return list(whole / pieces * (1 + slow))

    price = over_seeds(taken(1.0, 50), taken(0.1, 10))
    assert abs(price.ratio - 0.1) < 1e-12
    # Of nine turns drawn again, all are the same few now and then: 1 / 3 of seven, say.
    assert price.low < 0.1 < price.high
    assert half_width(price) < 0.05


def test_whole_runs_are_timed_by_enough_turns_or_not_at_all() -> None:
    """A model beside itself: from few turns an interval would look narrower than it is."""
    model = mujoco.MjModel.from_xml_string(SWING)
    start = np.empty((1, mujoco.mj_stateSize(model, INTEGRATION)))
    mujoco.mj_getState(model, mujoco.MjData(model), start[0], INTEGRATION)
    motion = Motion(model, start, np.empty((1, 40, 0)), name="whole")
    clock = Clock(Yardsticks.of([motion], 2, 1), model)
    assert not clock.whole([(model, 2)], [[motion]], -math.inf)
    (price,) = clock.whole([(model, 2)], [[motion]], math.inf)
    assert 0 < price.low <= price.ratio <= price.high < math.inf


class _Seed:
    """Turns of one seed: the model as written takes a second, another so many."""

    def __init__(self, ratio: float) -> None:
        self._ratio = ratio

    def taken(self) -> list[np.ndarray]:
        """Return both."""
        return [np.ones(1), np.full(1, self._ratio)]


@pytest.mark.parametrize(("ratios", "begun"), [((0.5, 0.5), 2), ((0.4, 0.6), 20)])
def test_seeds_that_differ_are_followed_by_more(
    ratios: tuple[float, float], begun: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half the 95 % interval is 1.96 x 0.1 / sqrt(n) / 0.5: 28 % of 2 seeds, 9 % of 20."""
    model = mujoco.MjModel.from_xml_string(SWING)
    start = np.empty((2, mujoco.mj_stateSize(model, INTEGRATION)))
    for row in start:
        mujoco.mj_getState(model, mujoco.MjData(model), row, INTEGRATION)
    motion = Motion(model, start, np.empty((2, 4, 0)), name="whole")
    clock, known = Clock(Yardsticks.of([motion], 2, 1), model), list[int]()

    def turn(_made: object, _motions: object, seed: int) -> _Seed:
        known.append(seed)
        return _Seed(ratios[seed])

    monkeypatch.setattr(clock, "_turn", turn)
    (price,) = clock.whole([(model, 2)], [[motion]] * 10, math.inf)
    assert len(known) == begun
    assert abs(price.ratio - 0.5) < 1e-12
    assert half_width(price) < 0.13


def test_what_a_twin_takes_as_well_is_no_saving() -> None:
    noise = Price(0.99, 0.94, 1.03)
    assert is_faster(Price(0.9, 0.88, 0.93), noise)
    assert not is_faster(Price(0.9, 0.86, 0.95), noise)
    # A twin that looks slow makes nothing fast that is not.
    assert not is_faster(Price(1.01, 1.0, 1.02), Price(1.05, 1.03, 1.07))
    assert price_text(Price(0.0183, 0.0179, 0.0191)) == "x0.018 (0.018 to 0.019)"
    assert price_text(Price(0.95, 0.9, 1.0)) == "x0.95 (0.90 to 1.00)"


class _Machine:
    """A batch of simulations, and a clock of steps that take so long each.

    They take twice as long half of the time, in spells of 1 to 3 ms.
    """

    def __init__(self) -> None:
        self.now, self.cost, self.state = 0.0, 0.0, np.zeros((1, 1))
        self._spells = np.random.default_rng(0).uniform(1e-3, 3e-3, 10_000).cumsum()

    def rollout(self, steps: int, **_: object) -> None:
        """Take the time of so many steps."""
        slow = np.searchsorted(self._spells, self.now) % 2
        self.now += steps * self.cost * (1 + slow)


def test_what_slows_a_machine_down_at_times_favours_no_fast_model(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One model takes 20 ms, another 0.2; each of their pieces is left alone as likely.

    A loop adds 1 us to steps of 200 and 2 us. A piece is slow in both turns a quarter of the time.
    If that were so of the slow model alone, the ratio would be 0.8 of the right one. The mean over
    20 tries of 10 copies has a standard error of sqrt(3 / 16 / 10 / 20) / 1.25 = 0.025.
    """
    machine = _Machine()
    monkeypatch.setattr(timing, "looped", lambda: 1e-6)
    monkeypatch.setattr(time, "thread_time", lambda: machine.now)
    model, found = mujoco.MjModel.from_xml_string(SWING), list[float]()
    stretch = Stretch(np.zeros((1, 1)), np.empty((1, 101, 0)), 0, 101)
    for _ in range(20):
        timed = list[Timed]()
        for cost in (2e-4, 2e-6):
            batches = Batches()
            monkeypatch.setattr(batches, "of", partial(_costing, machine, cost))
            timed.append(Timed(model, [stretch], batches))
        turn = Turn(timed)
        turns = [turn.taken(), turn.taken()]
        slow, fast = (np.minimum(*each).sum() for each in zip(*turns, strict=True))
        found.append(fast / slow)
    assert abs(np.mean(found) / (3 / 201) - 1) < 0.08


def _costing(machine: _Machine, cost: float, *_: object) -> _Machine:
    machine.cost = cost
    return machine
