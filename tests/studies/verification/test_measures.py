"""A measure is worse beyond its spread, its relative tolerance and its floor."""

import numpy as np
import pytest

from contactlab.studies.verification.run_measures import RELATIVE_TOLERANCE, average_measure


@pytest.mark.parametrize("before", [1.0, 250.0])
@pytest.mark.parametrize(
    ("twin", "floor", "allowed"),
    [
        (0.0, 0.0, RELATIVE_TOLERANCE),
        (2 * RELATIVE_TOLERANCE, 0.0, 2 * RELATIVE_TOLERANCE),
        (0.0, 3 * RELATIVE_TOLERANCE, 3 * RELATIVE_TOLERANCE),
    ],
)
def test_the_largest_tolerance_counts(
    before: float, twin: float, floor: float, allowed: float
) -> None:
    """All three are shares of the value before: what a twin adds, a relative one, and the floor."""
    for factor, worse in ((0.99, False), (1.01, True)):
        after = before * (1 + factor * allowed)
        means = before, after, before * (1 + twin), before
        values = [lambda each=each: np.array([each]) for each in means]
        found = average_measure(
            "depth", "task", "m", values, floor * before, "floor", chaotic=False
        )
        assert found.worse is worse
