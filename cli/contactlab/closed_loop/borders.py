"""Finds the border of the values of a parameter that keep a loop stable."""

import math
from collections.abc import Callable


def find_border(
    holds: Callable[[float], bool], inside: float, outside: float, precision: float = 3e-3
) -> float:
    """Return the border between a value that holds and one that does not, by bisection.

    The larger of the two over the smaller ends within `1 + precision`. If one of them is 0, the
    other comes nearer by factors of 100 first.
    """
    step, least = 100.0, 1e-12 * max(inside, outside)
    while not outside and inside > least:
        outside, inside = (0.0, inside / step) if holds(inside / step) else (inside / step, inside)
    while not inside and outside > least:
        inside, outside = (
            (outside / step, outside) if holds(outside / step) else (0.0, outside / step)
        )
    while max(inside, outside) > (1 + precision) * min(inside, outside) > 0:
        middle = math.sqrt(inside * outside)
        inside, outside = (middle, outside) if holds(middle) else (inside, middle)
    return inside
