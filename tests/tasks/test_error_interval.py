"""The interval of an error holds the mean over many seeds, of skewed distributions, too."""

from collections.abc import Callable

import numpy as np
import pytest

from contactlab.tasks.reference_error import ErrorEstimate

Draw = Callable[[np.random.Generator, int], np.ndarray]


def estimate(shares: np.ndarray) -> ErrorEstimate:
    low, high = float(shares.min()), float(shares.max())
    return ErrorEstimate(
        float(shares.mean()), "arm", "rest", 0.0, low, high, tuple(shares.tolist())
    )


@pytest.mark.parametrize(
    ("draw", "mean", "least"),
    [
        (lambda rng, count: rng.normal(5.0, 1.0, count), 5.0, 0.93),
        (lambda rng, count: rng.exponential(1.0, count), 1.0, 0.91),
        # One seed in five meets a stop.
        (lambda rng, count: 1.0 + 9.0 * (rng.random(count) < 0.2), 2.8, 0.9),
    ],
)
def test_it_covers_the_mean(draw: Draw, mean: float, least: float) -> None:
    rng = np.random.default_rng(1)
    found = [estimate(draw(rng, 24)).mean_interval() for _ in range(400)]
    assert np.mean([low <= mean <= high for low, high in found]) >= least


def test_a_long_tail_widens_its_own_end_only() -> None:
    shares = 50 + np.array([1.0, 1.1, 0.9, 1.0, 1.05, 5.0])
    low, high = estimate(shares).mean_interval()
    assert high - shares.mean() > 1.2 * (shares.mean() - low)
    mirrored = [100 - end for end in estimate(100 - shares).mean_interval()]
    assert mirrored == pytest.approx([high, low])


def test_equal_seeds_have_no_interval_and_one_seed_has_its_range() -> None:
    assert estimate(np.full(5, 0.25)).mean_interval() == (0.25, 0.25)
    assert estimate(np.array([0.25])).mean_interval() == (0.25, 0.25)
