"""Derivatives of values that are known up to an error, each with a bound on its own.

**Of a run**, whose error is rounding: Richardson's extrapolation of central differences D(s) over a
ladder of spans s. Where f is smooth, D(s) is off by s^2 f''' / 6 + O(s^4); with the next smaller
span E = (r^2 D(s / r) - D(s)) / (r^2 - 1) takes out the second order. Its distance from D(s / r)
estimates the error of that one and so bounds its own, of fourth order; where f has a switch within
s, the two part, and the bound says so. Errors N of the values reach E by at most
N / s (r^3 + 1) / (r^2 - 1). Of all spans the one with the least bound is told.

**Of a model**, of which runs are known whose error is that of stepping: where a contact is made
against the clock of the steps moves their end to and fro by a few percent, with as many jumps in a
span as the event passes steps. So the derivative is the slope of a parabola through many runs of
one span (Lanczos; Savitzky and Golay), each pair of them at a step of its own, so that places of
the event within a step are all met. What bounds its error is said at `slope`.
"""

import math
from typing import NamedTuple

import numpy as np

from contactlab.contact.trace_arrays import Floats

# Of one span and the next smaller: no whole number, since jumps at a step repeat with the spans.
RATIO = 3.7
SPANS = 0.1 * RATIO ** -np.arange(15.0)  # over the scale of what is varied
NOISE_SPAN = 2.0**-32  # over the scale, between neighbours of NOISE_POINTS
NOISE_POINTS = np.arange(-3.0, 4.0)
WIDE_SPANS = np.array([0.25, 0.07, 0.02])  # over the scale, for the model's
ABOUT = np.linspace(-1.0, 1.0, 24)  # points within a span; even, so that none is the middle
_ORDERS = (3, 4, 5)
_DEVIATIONS, _ERRORS = 4.0, 3.0
_ULP = float(np.finfo(float).eps)


class Estimate(NamedTuple):
    """A derivative, the bound on its error, and the span that gave it; NaN and infinite if none."""

    value: float
    bound: float
    span: float


NONE = Estimate(math.nan, math.inf, math.nan)


def scale_of(value: float) -> float:
    """Return the scale by which a parameter is varied: its size, 1 if it is 0."""
    return abs(value) or 1.0


def noise_of(values: Floats) -> float:
    """Return a bound on the error of values (7,) at equal and tiny distances.

    Differences of high order take out the smooth part, and leave of independent errors of variance
    v a mean square of v (2 k)! / (k!)^2. Source: J. More and S. Wild, Estimating Computational
    Noise, SIAM J. Sci. Comput. 33 (2011); here four deviations, and at least what a float resolves.
    """
    deviations = [
        math.sqrt(math.factorial(k) ** 2 / math.factorial(2 * k) * np.mean(np.diff(values, k) ** 2))
        for k in _ORDERS
    ]
    return max(_DEVIATIONS * max(deviations), _ULP * float(np.abs(values).max()))


def ladder_about(value: float) -> Floats:
    """Return (2 K,) points above a value, by falling spans, then those below it."""
    return value + scale_of(value) * np.concatenate([SPANS, -SPANS])


def differences(points: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Return (K,) spans and central differences, of values at a ladder's points (2 K,).

    Points are rounded, which matters below a span of the root of that.
    """
    (ups, downs), (above, below) = np.split(points, 2), np.split(values, 2)
    spans = (ups - downs) / 2
    return spans, (above - below) / (2 * spans)


def extrapolated(points: Floats, values: Floats, noise: float) -> Estimate:
    """Return the extrapolated difference with the least bound, of a ladder's; see above."""
    spans, plain = differences(points, values)
    square = RATIO**2
    better = (square * plain[1:] - plain[:-1]) / (square - 1)
    bounds = np.abs(better - plain[1:]) + noise / spans[:-1] * (RATIO**3 + 1) / (square - 1)
    return _least(better, bounds, spans[:-1])


def slope(spans: Floats, fine: Floats, coarse: Floats) -> Estimate:
    """Return the slope with the least bound, of values (K, M) at `ABOUT` within each of K spans.

    Those of `fine` are by steps half of those of `coarse`. The bound is the sum of the distance
    between the slopes of a parabola and of a cubic, whose error is of fourth order; of three
    standard errors of the cubic's, as its residuals give them; and of the distance between both
    sets of values, as large as the error of the finer one where that is of first order.
    """
    slopes, (cubic, errors) = _fitted(fine, 2)[0], _fitted(fine, 3)
    bounds = _ERRORS * errors + np.abs(cubic - slopes) + np.abs(_fitted(coarse, 2)[0] - slopes)
    return _least(slopes / spans, bounds / spans, spans)


def _fitted(values: Floats, degree: int) -> tuple[Floats, Floats]:
    """Return (K,) slopes at the middle of polynomials through (K, M) values, and their errors."""
    powers = np.vander(ABOUT, degree + 1, increasing=True)
    inverse = np.linalg.pinv(powers)
    found = values @ inverse.T
    rest = values - found @ powers.T
    deviations = np.sqrt((rest**2).sum(axis=1) / (len(ABOUT) - degree - 1))
    return found[:, 1], deviations * float(np.linalg.norm(inverse[1]))


def _least(values: Floats, bounds: Floats, spans: Floats) -> Estimate:
    bounds = np.where(np.isfinite(bounds), bounds, np.inf)
    best = int(bounds.argmin())
    if math.isinf(bounds[best]):
        return NONE
    return Estimate(float(values[best]), float(bounds[best]), float(spans[best]))
