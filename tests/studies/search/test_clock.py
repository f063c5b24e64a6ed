"""Intervals of ratios, by what order statistics say."""

import math

import numpy as np

from contactlab.studies.search.clock import half_width, interval, over_seeds


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
