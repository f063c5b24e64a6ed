"""The pareto_front is what no point beats, and all of it."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from contactlab.pareto.recommendation import pareto_front

# Few values, so that ties and equal points come up.
VALUES = st.one_of(st.sampled_from([0.0, 1.0, 2.0, 3.0, math.nan]), st.floats(0, 10))
POINTS = st.lists(st.tuples(VALUES, VALUES), max_size=25)


def beats(first: tuple[float, float], second: tuple[float, float]) -> bool:
    """Say whether a point is no worse than another in both, and better in one."""
    return first != second and first[0] <= second[0] and first[1] <= second[1]


@given(POINTS)
def test_a_point_is_on_the_front_if_and_only_if_none_beats_it(
    points: list[tuple[float, float]],
) -> None:
    known = [point for point in points if not any(map(math.isnan, point))]
    expected = {
        index
        for index, point in enumerate(points)
        if not any(map(math.isnan, point)) and not any(beats(other, point) for other in known)
    }
    table = np.array(points).reshape(-1, 2)
    assert set(pareto_front(table[:, 0], table[:, 1])) == expected


@given(POINTS)
def test_along_the_front_time_grows_and_error_falls(points: list[tuple[float, float]]) -> None:
    table = np.array(points).reshape(-1, 2)
    line = table[pareto_front(table[:, 0], table[:, 1])]
    assert (np.diff(line[:, 0]) >= 0).all()
    assert (np.diff(line[:, 1]) <= 0).all()
