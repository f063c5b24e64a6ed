"""How well a rate is known from counts."""

import math

_Z = 1.959963984540054
"""The normal quantile of 97.5 %."""


def wilson(good: int, runs: int) -> tuple[float, float]:
    """Return the 95 % interval of a rate, between 0 and 1.

    E. B. Wilson, "Probable inference, the law of succession, and statistical inference", 1927: the
    rates p whose distance to the observed share is at most z sqrt(p (1 - p) / n).

    Args:
        good: how often it came out.
        runs: of how many, at least 1.
    """
    share, weight = good / runs, _Z * _Z / runs
    centre = (share + weight / 2) / (1 + weight)
    reach = _Z * math.sqrt(share * (1 - share) / runs + weight / (4 * runs)) / (1 + weight)
    return max(0.0, centre - reach), min(1.0, centre + reach)
