"""Errors of points on more seeds: their intervals hold the mean, and seeds stop where they may."""

from collections.abc import Callable
from statistics import fmean

import numpy as np
import pytest

from contactlab.shares import mean_interval
from contactlab.studies.search.seed_errors import (
    MOST_SEEDS,
    SeededPoint,
    estimate_mean,
    narrow_errors,
)
from contactlab.tasks.reference_error import ErrorEstimate

Draw = Callable[[np.random.Generator, int], np.ndarray]


def estimate(shares: np.ndarray) -> ErrorEstimate:
    """Return the error of one phase from (S, B) shares."""
    own = shares[:, shares.mean(axis=0).argmax()].tolist()
    return ErrorEstimate(
        fmean(own), "arm", "rest", 0.0, min(own), max(own), tuple(own), by_phase=(shares,)
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
def test_an_interval_covers_the_mean(draw: Draw, mean: float, least: float) -> None:
    rng = np.random.default_rng(1)
    found = [mean_interval(draw(rng, 24).tolist()) for _ in range(400)]
    assert np.mean([low <= mean <= high for low, high in found]) >= least


def test_a_long_tail_widens_its_own_end_only() -> None:
    values = np.array([1.0, 1.1, 0.9, 1.0, 1.05, 5.0])
    low, high = mean_interval(values.tolist())
    assert high - values.mean() > 1.2 * (values.mean() - low)
    mirrored = [-end for end in mean_interval((-values).tolist())]
    assert mirrored == pytest.approx([high, low])


def test_equal_values_and_one_value_have_themselves() -> None:
    assert mean_interval([0.25] * 5) == mean_interval([0.25]) == (0.25, 0.25)


def test_another_body_may_be_the_worst_on_more_seeds() -> None:
    first = np.array([[3.0, 1.0], [3.2, 1.0], [3.1, 1.0]])
    more = np.concatenate([first, [[0.0, 2.0]] * 9])
    found = estimate_mean(estimate(first), (more,))
    assert found.error == more[:, 1].mean()
    assert found.shares == tuple(more[:, 1])
    assert found.low <= found.error <= found.high
    assert found.high >= mean_interval(more[:, 0].tolist())[1]


def make_point(spread: float, seconds: float = 1.0) -> tuple[SeededPoint, list[tuple[int, int]]]:
    """Return a point whose seeds differ by a share, and the seeds that it is measured on."""
    asked = list[tuple[int, int]]()
    shares = (1 + spread * np.random.default_rng(0).standard_normal((200, 1))).clip(0.01)

    def measure(used: int, count: int) -> ErrorEstimate:
        asked.append((used, count))
        return estimate(shares[3 + used : 3 + used + count])

    return SeededPoint(estimate(shares[:3]), seconds, measure), asked


def test_seeds_are_added_until_the_interval_is_narrow() -> None:
    (alike, none), (some, few), (wild, many) = map(make_point, (0.01, 0.2, 0.9))
    narrow_errors([alike, some, wild], 3, 1e6)
    assert not none
    assert 3 < len(some.error.shares) < len(wild.error.shares) == MOST_SEEDS
    assert some.error.high - some.error.low <= 0.3 * some.error.error
    for point, asked in ((some, few), (wild, many)):
        used = [place for first, count in asked for place in range(first, first + count)]
        assert used == list(range(len(point.error.shares) - 3))


def test_work_limits_the_seeds_and_goes_to_the_first_points() -> None:
    (first, _), (second, _) = make_point(0.9, 2.0), make_point(0.9, 100.0)
    narrow_errors([first, second], 3, 20.0)
    assert len(first.error.shares) == 12
    assert len(second.error.shares) == 3


def test_a_point_that_gives_up_on_a_seed_has_no_high_end() -> None:
    shares = np.array([[1.0], [2.0], [3.0]])
    point = SeededPoint(
        estimate(shares),
        1.0,
        lambda _, count: ErrorEstimate(
            np.inf, "arm", "rest", 0.0, np.inf, np.inf, by_phase=(np.ones((count, 1)),)
        ),
    )
    narrow_errors([point], 3, 1e6)
    assert point.error.error == 2.0
    assert np.isinf(point.error.high)
