"""Intervals of ratios, by what order statistics say."""

import math

import mujoco
import numpy as np

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.budget.prices import Price
from contactlab.studies.search.clock import Clock, half_width, interval, over_seeds
from contactlab.studies.search.wording import is_faster, price_text
from contactlab.studies.search.yardstick import Yardsticks

SWING = """<mujoco><option timestep="0.002"/><worldbody><body><joint axis="0 1 0"/>
<geom type="capsule" size=".02" fromto="0 0 0 1 0 0"/></body></worldbody></mujoco>"""


def test_an_interval_has_the_ranks_of_the_binomial_distribution() -> None:
    """Of 11 turns the second least and largest: at most 1 below has 2 (1 + 11) / 2^11 = 1.2 %."""
    price = interval([float(number) for number in range(11)])
    assert (price.low, price.ratio, price.high) == (1, 5, 9)
    assert interval([1.0, 2.0, 3.0]) == (2.0, 1.0, 3.0)
    assert math.isnan(interval([]).ratio)


def test_intervals_cover_the_median_as_often_as_they_say() -> None:
    generator, covered = np.random.default_rng(0), 0
    for _ in range(400):
        price = interval(generator.lognormal(sigma=0.3, size=25).tolist())
        covered += price.low <= 1 <= price.high
    assert covered >= 0.92 * 400
    assert half_width(interval([1.0] * 11)) == 0


def test_seeds_count_by_the_time_that_they_take() -> None:
    """One seed takes 3 s and is halved, one takes 1 s and stays: 2.5 s of 4 s."""
    price = over_seeds([3.0, 1.0], np.array([[0.5] * 3, [1.0] * 3]))
    assert price.ratio == 2.5 / 4
    # Drawn seeds may all be the one or all the other, a quarter of the draws each.
    assert (price.low, price.high) == (0.5, 1.0)
    # Of these seeds nothing is left to learn, whose turns agree.
    assert over_seeds([3.0, 1.0], np.array([[0.5] * 3, [1.0] * 3]), seeds=False) == (2.5 / 4,) * 3


def test_seeds_that_agree_leave_the_noise_of_turns() -> None:
    ratios = np.random.default_rng(1).normal(0.5, 0.01, size=(6, 9))
    price = over_seeds([1.0] * 6, ratios)
    assert price.low < 0.5 < price.high
    # The median of 54 turns scatters by 1.25 sigma / sqrt(54) = .0017, so 95 % within .0034.
    assert half_width(price) * price.ratio < 3 * 0.0034


def test_without_time_one_seed_tells_of_whole_runs() -> None:
    """A model takes a turn beside itself, whatever the time, and no second one."""
    model = mujoco.MjModel.from_xml_string(SWING)
    starts = np.empty((3, mujoco.mj_stateSize(model, INTEGRATION)))
    mujoco.mj_getState(model, mujoco.MjData(model), starts[0], INTEGRATION)
    starts[1:] = starts[0]
    motion = Motion(model, starts, np.empty((3, 40, 0)), name="whole")
    clock = Clock(Yardsticks.of([motion], 2, 1), model)
    (price,) = clock.whole([(model, 2)], [motion], -math.inf)
    assert price.low == price.ratio == price.high > 0


def test_what_a_twin_takes_as_well_is_no_saving() -> None:
    noise = Price(0.99, 0.94, 1.03)
    assert is_faster(Price(0.9, 0.88, 0.93), noise)
    assert not is_faster(Price(0.9, 0.86, 0.95), noise)
    # A twin that looks slow makes nothing fast that is not.
    assert not is_faster(Price(1.01, 1.0, 1.02), Price(1.05, 1.03, 1.07))
    assert price_text(Price(0.0183, 0.0179, 0.0191)) == "x0.018 (0.018 to 0.019)"
    assert price_text(Price(0.95, 0.9, 1.0)) == "x0.95 (0.90 to 1.00)"
