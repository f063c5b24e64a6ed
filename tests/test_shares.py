"""Intervals of shares hold as often as they say."""

import math
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import betaln
from scipy.stats import binom, binomtest, hypergeom

from contactlab.shares import (
    all_good,
    anytime_interval,
    evidence_against,
    paired_chance,
    paired_difference,
    paired_score,
    pairs_to_tell,
    runs_to_tell,
    unequal_chance,
    unpaired_difference,
    wilson_interval,
)

COUNTS = st.integers(1, 400).flatmap(lambda runs: st.tuples(st.integers(0, runs), st.just(runs)))


@given(counts=COUNTS, share=st.floats(0.001, 0.999))
def test_the_evidence_is_the_mean_likelihood_over_that_of_a_share(
    counts: tuple[int, int], share: float
) -> None:
    """The mean of p^k (1 - p)^(n - k) over all p is the beta function of k + 1 and n - k + 1.

    Terms are at most n |log .001|, 2,800, so that rounding leaves 1e-12 of that.
    """
    good, runs = counts
    mean = betaln(good + 1, runs - good + 1)
    likely = good * math.log(share) + (runs - good) * math.log1p(-share)
    assert evidence_against(share, good, runs) == pytest.approx(mean - likely, abs=1e-8)


@given(counts=COUNTS, sure=st.sampled_from([0.5, 0.9, 0.95, 0.999]))
def test_the_interval_has_the_shares_without_evidence_against_them(
    counts: tuple[int, int], sure: float
) -> None:
    good, runs = counts
    low, high = anytime_interval(good, runs, sure)
    assert 0 <= low <= good / runs <= high <= 1
    limit = -math.log1p(-sure)
    for edge, outer in ((low, 0.0), (high, 1.0)):
        # Of a convex function, an edge is a root unless it is an end.
        if edge != outer:
            assert evidence_against(edge, good, runs) == pytest.approx(limit, abs=1e-6)


@pytest.mark.parametrize("share", [0.02, 0.3, 0.5])
def test_it_holds_at_all_looks_at_once(share: float) -> None:
    """Of 1,000 sequences of 1,000 runs, the share is left out at any time in at most 5 %.

    The bound is what a count with that chance exceeds once in 10^4 such tests.
    """
    sequences, length = 1_000, 1_000
    draws = np.random.default_rng(0).random((sequences, length)) < share
    good, runs = draws.cumsum(axis=1), np.arange(1, length + 1)
    mean = betaln(good + 1, runs - good + 1)
    likely = good * math.log(share) + (runs - good) * math.log1p(-share)
    left_out = ((mean - likely) >= -math.log(0.05)).any(axis=1).sum()
    assert left_out <= binom.isf(1e-4, sequences, 0.05)


def test_wilsons_exact_coverage_is_that_of_its_name() -> None:
    """The binomial is summed, not drawn: over shares of .02 to .98, for 20 to 200 runs.

    Coverage of a count jumps between shares; on average it is 94.9 to 95.5 %.
    """
    shares = np.linspace(0.02, 0.98, 193)[:, None]
    for runs in (20, 35, 50, 100, 200):
        counts = np.arange(runs + 1)
        low, high = np.transpose([wilson_interval(good, runs) for good in counts.tolist()])
        chances = binom.pmf(counts, runs, shares)
        covered = (chances * ((low <= shares) & (shares <= high))).sum(axis=1)
        assert 0.949 < covered.mean() < 0.955
        assert covered.min() > 0.89
        ends = [binomtest(good, runs).proportion_ci(method="wilson") for good in (0, 7, runs)]
        own = [wilson_interval(good, runs) for good in (0, 7, runs)]
        assert np.allclose(own, [(end.low, end.high) for end in ends], atol=1e-12)


def test_nothing_is_known_without_runs() -> None:
    assert anytime_interval(0, 0) == (0.0, 1.0)


PAIRED = st.tuples(st.integers(0, 40), st.integers(0, 40), st.integers(1, 60)).map(
    lambda counts: (counts[0], counts[1], sum(counts))
)


@given(counts=PAIRED)
def test_the_interval_of_a_paired_difference_has_the_one_observed(
    counts: tuple[int, int, int],
) -> None:
    gained, lost, pairs = counts
    low, high = paired_difference(gained, lost, pairs)
    assert -1 <= low <= (gained - lost) / pairs <= high <= 1
    mirrored = paired_difference(lost, gained, pairs)
    assert mirrored == pytest.approx((-high, -low), abs=1e-9)


def test_a_published_interval() -> None:
    """Table of Tango (1998): 12 gained and 2 lost of 50, .0400 to .3600 or so by Wald; his differs.

    Here the score itself is held to 1.96 at both ends, from its definition by a search on a grid.
    """
    low, high = paired_difference(12, 2, 50)
    for edge in (low, high):
        assert abs(_slow_score(12, 2, 50, edge)) == pytest.approx(1.959964, abs=1e-3)


def _slow_score(gained: int, lost: int, pairs: int, difference: float) -> float:
    """Return the score, whose shares are the likeliest of a fine grid."""
    least = max(0.0, -difference)
    shares = np.linspace(least + 1e-9, (1 - difference) / 2 - 1e-9, 200_001)
    with np.errstate(all="ignore"):
        likely = (
            gained * np.log(shares + difference)
            + lost * np.log(shares)
            + (pairs - gained - lost) * np.log(1 - 2 * shares - difference)
        )
    share = shares[np.nanargmax(likely)]
    variance = pairs * (2 * share + difference - difference**2)
    return float((gained - lost - pairs * difference) / math.sqrt(variance))


@pytest.mark.parametrize(("gain", "loss"), [(0.1, 0.1), (0.2, 0.05), (0.3, 0.15)])
def test_stated_intervals_hold_in_95_percent(gain: float, loss: float) -> None:
    """Of 10,000 pairs of policies over 200 episodes; counts are whole, so that it is 94 to 96 %."""
    draws = np.random.default_rng(3).multinomial(200, [gain, loss, 1 - gain - loss], size=10_000)
    held = [
        abs(paired_score(gained, lost, 200, gain - loss)) <= 1.959964
        for gained, lost, _ in draws.tolist()
    ]
    assert 0.94 <= np.mean(held) <= 0.96


def test_a_published_unpaired_interval() -> None:
    """Newcombe (1998), table II, method 10: 56 of 70 against 48 of 80."""
    assert unpaired_difference(56, 70, 48, 80) == pytest.approx((0.0524, 0.3339), abs=5e-5)


@given(counts=COUNTS)
def test_wilsons_interval(counts: tuple[int, int]) -> None:
    """Against SciPy's."""
    good, runs = counts
    exact = binomtest(good, runs).proportion_ci(method="wilson")
    low, high = wilson_interval(good, runs)
    assert (low, high) == pytest.approx((exact.low, exact.high), abs=1e-9)
    assert (low == 0, high == 1) == (good == 0, good == runs)


@pytest.mark.parametrize(("share", "before"), [(0.6, 0.5), (0.8, 0.6), (0.3, 0.3)])
def test_unpaired_intervals_hold_in_95_percent(share: float, before: float) -> None:
    """Of 10,000 pairs of policies over 200 and 150 episodes."""
    random = np.random.default_rng(7)
    counts = zip(
        random.binomial(200, share, 10_000).tolist(),
        random.binomial(150, before, 10_000).tolist(),
        strict=True,
    )
    intervals = (unpaired_difference(good, 200, were, 150) for good, were in counts)
    held = [low <= share - before <= high for low, high in intervals]
    assert 0.94 <= np.mean(held) <= 0.96


def test_so_many_runs_of_each_tell_in_four_of_five_times() -> None:
    """The interval and the formula differ by little: within a twentieth."""
    needed = runs_to_tell(0.6, 0.5)
    assert needed is not None
    counts = np.random.default_rng(9).binomial(needed, [0.6, 0.5], (2_000, 2)).tolist()
    told = [unpaired_difference(good, needed, were, needed)[0] > 0 for good, were in counts]
    assert 0.75 <= np.mean(told) <= 0.85
    assert runs_to_tell(0.5, 0.5) is None


@given(gained=st.integers(0, 60), lost=st.integers(0, 60))
def test_the_chance_is_that_of_the_exact_test(gained: int, lost: int) -> None:
    exact = binomtest(gained, gained + lost).pvalue if gained + lost else 1.0
    assert paired_chance(gained, lost) == pytest.approx(exact, rel=1e-9)


@given(some=st.integers(0, 40), rest=st.integers(0, 40), others=st.integers(0, 40))
def test_the_chance_of_unequal_shares_is_that_of_the_exact_test(
    some: int, rest: int, others: int
) -> None:
    exact = hypergeom.sf(some - 1, some + rest + 50, some + others, some + rest)
    assert unequal_chance(some, some + rest, others, 50) == pytest.approx(exact, rel=1e-9)


def test_so_many_pairs_tell_in_four_of_five_times() -> None:
    """The exact test has less power than its approximation, by a twentieth at 230 pairs."""
    gain, loss = 0.2, 0.1
    pairs = pairs_to_tell(200, 100, 1000)
    assert pairs is not None
    draws = np.random.default_rng(5).multinomial(pairs, [gain, loss, 1 - gain - loss], size=2_000)
    told = np.mean([paired_chance(gained, lost) < 0.05 for gained, lost, _ in draws.tolist()])
    assert 0.74 <= told <= 0.84
    assert pairs_to_tell(3, 3, 10) is None


def test_all_of_some_runs_are_good() -> None:
    """Against every choice of them; of two settings the mean."""
    runs = [True] * 7 + [False] * 3
    for times in (1, 2, 3, 8):
        chosen = np.mean([all(each) for each in combinations(runs, times)])
        assert all_good(times, [(7, 10)])[0] == pytest.approx(chosen)
        assert all_good(times, [(7, 10), (10, 10)])[0] == pytest.approx((chosen + 1) / 2)


def test_the_interval_of_several_good_ones_in_a_row_holds() -> None:
    """Of one setting as often as Wilson's does; of 2,000 draws of four settings in 95 % or more."""
    low, high = wilson_interval(29, 40)
    assert all_good(3, [(29, 40)])[1:] == pytest.approx((low**3, high**3))
    shares = (0.9, 0.8, 0.6, 0.3)
    truth = np.mean(np.power(shares, 3))
    draws = np.random.default_rng(3).binomial(40, shares, size=(2_000, len(shares)))
    spans = [all_good(3, [(good, 40) for good in each])[1:] for each in draws.tolist()]
    assert np.mean([low <= truth <= high for low, high in spans]) >= 0.95
