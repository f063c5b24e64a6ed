"""The worst of several measures is the one that uses most of its own limit."""

from itertools import permutations

import pytest

from contactlab.judge.limits import Limit, find_exceeding, utilization, worst_of

WIDE, NARROW = Limit("slip", "m", "gate", 10.0), Limit("slip", "m", "gate", 0.1)


@pytest.mark.parametrize(
    ("small", "large", "share"),
    [(0.2, 9.0, 2.0), (0.05, 20.0, 2.0), (0.099, 1.0, 0.99), (0.0, 1.0, 0.1)],
)
def test_the_worst_measure_uses_most_of_its_limit(small: float, large: float, share: float) -> None:
    """A large value of a wide limit is not worse than a small one beyond a narrow limit."""
    measures = [NARROW.measure(small, "floor"), WIDE.measure(large, "wall")]
    for order in permutations(measures):
        worst = worst_of(order)
        assert utilization(worst.value, worst.limit) == pytest.approx(share)


def test_a_measure_without_a_value_is_the_worst() -> None:
    missing = NARROW.measure(1.0, "floor").model_copy(update={"value": None})
    assert worst_of([WIDE.measure(99.0, "wall"), missing]) is missing


@pytest.mark.parametrize(("value", "strict", "holds"), [(0.1, False, True), (0.1, True, False)])
def test_a_value_at_its_limit_keeps_it_unless_that_is_strict(
    value: float, *, strict: bool, holds: bool
) -> None:
    measure = Limit("slip", "m", "gate", 0.1, strict=strict).measure(value, None)
    assert measure.holds is holds
    assert find_exceeding([measure]) == ([] if holds else [measure])
