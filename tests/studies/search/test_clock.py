"""Intervals of ratios, by what order statistics say."""

import math

import numpy as np

from contactlab.studies.search.clock import half_width, interval


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
