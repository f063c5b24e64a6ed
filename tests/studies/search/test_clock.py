"""Times of models in turns: the least of each piece, and intervals by resampling."""

import math

import mujoco
import numpy as np

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.budget.prices import Price
from contactlab.studies.search.clock import Clock, half_width, over_seeds
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
    assert not clock.whole([(model, 2)], [motion], -math.inf)
    (price,) = clock.whole([(model, 2)], [motion], math.inf)
    assert 0 < price.low <= price.ratio <= price.high < math.inf


def test_what_a_twin_takes_as_well_is_no_saving() -> None:
    noise = Price(0.99, 0.94, 1.03)
    assert is_faster(Price(0.9, 0.88, 0.93), noise)
    assert not is_faster(Price(0.9, 0.86, 0.95), noise)
    # A twin that looks slow makes nothing fast that is not.
    assert not is_faster(Price(1.01, 1.0, 1.02), Price(1.05, 1.03, 1.07))
    assert price_text(Price(0.0183, 0.0179, 0.0191)) == "x0.018 (0.018 to 0.019)"
    assert price_text(Price(0.95, 0.9, 1.0)) == "x0.95 (0.90 to 1.00)"
