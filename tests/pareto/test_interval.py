"""The interval of a rate, against its definition and another implementation."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from contactlab.shares import wilson_interval

COUNTS = st.integers(1, 500).flatmap(lambda runs: st.tuples(st.integers(0, runs), st.just(runs)))


@given(COUNTS)
def test_it_is_scipys(counts: tuple[int, int]) -> None:
    good, runs = counts
    interval = binomtest(good, runs).proportion_ci(0.95, method="wilson")
    assert wilson_interval(good, runs) == pytest.approx((interval.low, interval.high), abs=1e-12)


@given(COUNTS)
def test_its_ends_are_as_far_as_their_own_spread_allows(counts: tuple[int, int]) -> None:
    """|share - p| = z sqrt(p (1 - p) / n) at both ends that are not clipped."""
    good, runs = counts
    for end in wilson_interval(good, runs):
        if 1e-9 < end < 1 - 1e-9:
            reach = 1.959963984540054 * math.sqrt(end * (1 - end) / runs)
            assert abs(good / runs - end) == pytest.approx(reach, rel=1e-6)
