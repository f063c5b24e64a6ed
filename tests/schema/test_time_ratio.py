"""Tests of ratios of times: a ratio is less, equal or greater by its interval and by relevance."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.schema.time_ratio import LEAST_SAVING, SIMPLER_SHARE, TimeRatio, cost_class

NUMBERS = st.floats(0.01, 100)


@given(st.tuples(NUMBERS, NUMBERS, NUMBERS).map(sorted), NUMBERS, st.floats(0, 0.5))
def test_a_ratio_is_less_equal_or_greater(parts: list[float], than: float, by: float) -> None:
    """Exactly one of the three holds, and the two that say more need the whole interval."""
    low, ratio, high = parts
    one = TimeRatio.of(ratio, low, high)
    found = [one.is_less(than, by=by), one.is_equal(than, by=by), one.is_greater(than, by=by)]
    assert sum(found) == 1
    if low <= than <= high:
        assert found == [False, True, False]


@pytest.mark.parametrize(
    ("parts", "is_less", "saves"),
    [
        ((0.90, 0.88, 0.92), True, True),
        ((0.98, 0.97, 0.99), True, False),  # less beyond doubt, and irrelevant
        ((0.90, 0.79, 1.01), False, False),  # relevant if true, and in doubt
        ((1.10, 1.08, 1.12), False, False),
    ],
)
def test_a_saving_is_beyond_doubt_and_relevant(
    parts: tuple[float, float, float], is_less: bool, saves: bool
) -> None:
    ratio = TimeRatio.of(*parts)
    assert (ratio.is_less(), ratio.is_less(by=LEAST_SAVING)) == (is_less, saves)


def test_pairs_give_their_median_and_its_interval() -> None:
    """Of eleven pairs, at most one lies on one side of the interval: 2 (1 + 11) / 2^11 = 1.2 %."""
    ratios = np.random.default_rng(0).permutation(np.arange(1.0, 12.0))
    assert TimeRatio.of_pairs(ratios.tolist()) == TimeRatio.of(6.0, 2.0, 10.0)


@pytest.mark.parametrize("pairs", [2, 3, 5])
def test_few_pairs_miss_the_ratio_no_more_often_than_many(pairs: int) -> None:
    """Of 400 intervals of 95 %, 20 miss; 40 are 4.6 standard deviations more."""
    logs = np.random.default_rng(pairs).normal(math.log(0.9), 0.2, (400, pairs))
    ratios = [TimeRatio.of_pairs(np.exp(row).tolist()) for row in logs]
    assert sum(not ratio.low <= 0.9 <= ratio.high for ratio in ratios) < 40
    assert all(ratio.low <= ratio.ratio <= ratio.high for ratio in ratios)


def test_a_burst_in_one_of_few_rounds_is_no_saving() -> None:
    assert TimeRatio.of_pairs([0.33, 0.96, 0.98]).is_equal()
    assert TimeRatio.of_pairs([0.83, 0.82, 0.82]).is_less(by=LEAST_SAVING)


@given(NUMBERS)
def test_costs_of_one_class_differ_by_a_tenth(ratio: float) -> None:
    factor = 1 + SIMPLER_SHARE
    one, near, far = (cost_class(each) for each in (ratio, ratio * factor**0.5, ratio * factor))
    assert one <= near <= far == pytest.approx(one + 1)
    assert cost_class(math.inf) > far


def test_a_scaled_ratio_keeps_its_interval() -> None:
    scaled = TimeRatio.of(0.5, 0.4, 0.75).scale_ratio(2)
    assert scaled == TimeRatio.of(1.0, 0.8, 1.5)
    assert scaled.half_width == pytest.approx(0.35)
