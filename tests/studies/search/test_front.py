"""The front has the candidates that no other one beats, few and apart, with the marked ones."""

import math

import numpy as np
import pytest

from contactlab.studies.search.configuration import Configuration
from contactlab.studies.search.front import (
    FrontRules,
    choose_contenders,
    choose_front,
    drop_slower,
)
from contactlab.studies.search.settings_search import Evaluation, error_of
from contactlab.tasks.reference_error import ErrorEstimate


def candidate(number: int, cost: float, error: float) -> Evaluation:
    estimate = ErrorEstimate(error, "ball", "rest", 0.0, error, error)
    return Evaluation(Configuration({}, number), estimate, cost)


def random_candidates(seed: int, count: int = 60) -> list[Evaluation]:
    rng = np.random.default_rng(seed)
    costs, errors = np.exp(rng.uniform(-3, 3, (2, count)))
    return [
        candidate(number, float(cost), float(1e-3 * error))
        for number, (cost, error) in enumerate(zip(costs, errors, strict=True), 1)
    ]


@pytest.mark.parametrize("seed", range(20))
def test_no_candidate_beats_a_point_distinctly(seed: int) -> None:
    found = random_candidates(seed)
    rules = FrontRules(most=len(found))
    points = choose_front(found, [], math.inf, rules=rules)
    assert points == sorted(points, key=lambda one: -one.cost)
    for point in points:
        assert not any(
            other.cost < point.cost and error_of(other) < error_of(point) for other in found
        )
    # Each candidate has a point that is no worse, as far as both can be distinguished.
    for one in found:
        assert any(
            point.cost <= rules.cost_ratio * one.cost
            and error_of(point) <= rules.error_ratio * error_of(one)
            for point in points
        )


@pytest.mark.parametrize("seed", range(5))
def test_few_points_span_the_front_and_marked_ones_stay(seed: int) -> None:
    found = random_candidates(seed, 200)
    marked = found[:2]
    points = choose_front(found, marked, math.inf)
    assert len(points) <= FrontRules().most
    assert all(any(point is one for point in points) for one in marked)
    whole = choose_front(found, marked, math.inf, rules=FrontRules(most=200))
    assert (points[0], points[-1]) == (whole[0], whole[-1])


def test_points_that_cannot_be_distinguished_are_one() -> None:
    slow, same_time, same_error, fast = (
        candidate(1, 2.0, 1e-3),
        candidate(2, 1.95, 2e-3),
        candidate(3, 1.0, 1.1e-3),
        candidate(4, 0.5, 5e-3),
    )
    assert choose_front([slow, same_time, fast], [], 1.0) == [slow, fast]
    assert choose_front([slow, same_error, fast], [], 1.0) == [same_error, fast]
    twin = candidate(5, 0.51, 5.1e-3)
    assert choose_front([slow, fast, twin], [twin], 1.0) == [slow, twin]
    # A marked candidate is the one that stays.
    assert choose_front([slow, same_time, fast], [same_time], 1.0) == [same_time, fast]
    assert choose_front([slow, fast], [], 2e-3) == [slow]


@pytest.mark.parametrize("seed", range(5))
def test_of_measured_points_each_is_faster_than_all_more_accurate_ones(seed: int) -> None:
    found = sorted(random_candidates(seed), key=error_of)
    marked = {found[30].configuration.key}
    rows = [(str(number), one, one.error) for number, one in enumerate(found) if one.error]
    kept = drop_slower(rows, lambda row: row[1].cost, marked)
    for place, (_, one, _) in enumerate(rows):
        beaten = any(other.cost <= one.cost for _, other, _ in rows[:place])
        assert (rows[place] in kept) == (not beaten or one.configuration.key in marked)


def test_contenders_hold_all_that_noise_may_rank_wrongly() -> None:
    rules = FrontRules(contenders=100)
    found = random_candidates(1)
    contenders = choose_contenders(found, found[:1], 1e-2, rules)
    for one in found[1:]:
        cheaper = [error_of(other) for other in found if other.cost < one.cost]
        near = error_of(one) <= min(rules.noise * min(cheaper, default=math.inf), 1e-2)
        assert near == any(one is other for other in contenders)
    # Of two that move alike the cheaper one contends.
    fast, slow = candidate(1, 1.0, 2e-3), candidate(2, 1.1, 2e-3)
    assert choose_contenders([slow, fast], [], 1.0) == [fast]
