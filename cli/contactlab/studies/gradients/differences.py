"""Derivatives of values that are known up to an error, each with a bound on its own error.

**Slope of a run**, with an error from rounding: Richardson's extrapolation of central differences
D(s) over a ladder of spans s. If f is smooth, the error of D(s) is s^2 f''' / 6 + O(s^4). With the
next smaller span, E = (r^2 D(s / r) - D(s)) / (r^2 - 1) removes the second order. Its distance from
D(s / r) estimates the error of that one, and so bounds its own, of fourth order. If f has a switch
within s, the two differ, and the bound shows it. Errors N of the values affect E by at most N / s
(r^3 + 1) / (r^2 - 1). The span with the least bound is used.

**Slope of a model**, known from runs with the error of stepping: a contact that is made at another
fraction of a step moves the end by a few percent, with as many jumps in a span as the event passes
steps. So the derivative is the slope of a parabola through many runs of one span (Lanczos; Savitzky
and Golay). Each pair of runs has its own step, so that the event falls anywhere within a step. See
`fit_slope` for the bound on its error.
"""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from contactlab.contact.trace_arrays import Floats

_ULP = float(np.finfo(float).eps)


@dataclass(frozen=True)
class DifferencePlan:
    """Offsets of a parameter for differences, and the factors of their bounds.

    Attributes:
        ratio: of one span to the next smaller; not a whole number, since jumps at a step repeat.
        noise_offsets: of points that are so near that only rounding separates their values, over
            the scale.
        wide_spans: for the model's derivative, over the scale.
        within: points within a wide span; an even number, so that none is the middle.
        noise_deviations: deviations of the noise that bound it.
        slope_errors: standard errors of a slope that bound it.
    """

    ratio: float = 3.7
    noise_offsets: Floats = field(default_factory=lambda: 2.0**-32 * np.arange(-3.0, 4.0))
    wide_spans: Floats = field(default_factory=lambda: np.array([0.25, 0.07, 0.02]))
    within: Floats = field(default_factory=lambda: np.linspace(-1.0, 1.0, 24))
    noise_deviations: float = 4.0
    slope_errors: float = 3.0

    @property
    def spans(self) -> Floats:
        """Falling spans of central differences, over the scale of the parameter."""
        return 0.1 * self.ratio ** -np.arange(15.0)


PLAN = DifferencePlan()


class Estimate(NamedTuple):
    """A derivative, the bound on its error, and its span; NaN and infinite without one."""

    value: float
    bound: float
    span: float


NONE = Estimate(math.nan, math.inf, math.nan)


def parameter_scale(value: float) -> float:
    """Return the scale of a parameter's variation: its size, or 1 if it is 0."""
    return abs(value) or 1.0


def estimate_noise(values: Floats) -> float:
    """Return a bound on the error of values (7,) at equal and tiny distances.

    Differences of high order remove the smooth part. Independent errors of variance v leave a mean
    square of v (2 k)! / (k!)^2. Source: J. More and S. Wild, Estimating Computational Noise, SIAM
    J. Sci. Comput. 33 (2011); here four deviations, and at least the resolution of a float.
    """
    orders = (3, 4, 5)
    deviations = [
        math.sqrt(math.factorial(k) ** 2 / math.factorial(2 * k) * np.mean(np.diff(values, k) ** 2))
        for k in orders
    ]
    return max(PLAN.noise_deviations * max(deviations), _ULP * float(np.abs(values).max()))


def ladder_points(value: float) -> Floats:
    """Return (2 K,) points above a value, by falling spans, then those below it."""
    return value + parameter_scale(value) * np.concatenate([PLAN.spans, -PLAN.spans])


def central_differences(points: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Return (K,) spans and central differences, of values at a ladder's points (2 K,).

    Points are rounded, which matters below a span of the root of the resolution.
    """
    (ups, downs), (above, below) = np.split(points, 2), np.split(values, 2)
    spans = (ups - downs) / 2
    return spans, (above - below) / (2 * spans)


def extrapolate(points: Floats, values: Floats, noise: float) -> Estimate:
    """Return the extrapolated difference with the least bound; see above."""
    spans, plain = central_differences(points, values)
    square = PLAN.ratio**2
    better = (square * plain[1:] - plain[:-1]) / (square - 1)
    bounds = np.abs(better - plain[1:]) + noise / spans[:-1] * (PLAN.ratio**3 + 1) / (square - 1)
    return _smallest_bound(better, bounds, spans[:-1])


def fit_slope(spans: Floats, fine: Floats, coarse: Floats) -> Estimate:
    """Return the slope with the least bound, of values (K, M) at points within each of K spans.

    The points are `PLAN.within`. The steps of `fine` are half of those of `coarse`. The bound is
    the sum of three parts: the distance between the slopes of a parabola and of a cubic with an
    error of fourth order; three standard errors of the cubic's slope, from its residuals; and the
    distance between both sets of values, which equals the error of the finer one if that is of
    first order.
    """
    slopes, (cubic, errors) = _fit_polynomials(fine, 2)[0], _fit_polynomials(fine, 3)
    bounds = (
        PLAN.slope_errors * errors
        + np.abs(cubic - slopes)
        + np.abs(_fit_polynomials(coarse, 2)[0] - slopes)
    )
    return _smallest_bound(slopes / spans, bounds / spans, spans)


def _fit_polynomials(values: Floats, degree: int) -> tuple[Floats, Floats]:
    """Return (K,) slopes at the middle of polynomials through (K, M) values, and their errors."""
    powers = np.vander(PLAN.within, degree + 1, increasing=True)
    inverse = np.linalg.pinv(powers)
    coefficients = values @ inverse.T
    rest = values - coefficients @ powers.T
    deviations = np.sqrt((rest**2).sum(axis=1) / (len(PLAN.within) - degree - 1))
    return coefficients[:, 1], deviations * float(np.linalg.norm(inverse[1]))


def _smallest_bound(values: Floats, bounds: Floats, spans: Floats) -> Estimate:
    bounds = np.where(np.isfinite(bounds), bounds, np.inf)
    best = int(bounds.argmin())
    if math.isinf(bounds[best]):
        return NONE
    return Estimate(float(values[best]), float(bounds[best]), float(spans[best]))
