"""The values that an axis stands for.

Written-out values are the exact ones where these are rational, correctly rounded, so that a third
step of 0.1 is 0.3. Others are rounded to 12 digits: then they do not depend on a machine's
mathematics library, and runs of two machines pair up.
"""

import math
from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from contactlab.schema import (
    Axis,
    AxisSpec,
    Linspace,
    Logspace,
    Loguniform,
    Range,
    Sample,
    Uniform,
    Values,
)

_DIGITS = 12


def listed(axis: Axis) -> list[object]:
    """Return the values of an axis that is not sampled, in order, before they are canonical."""
    match axis:
        case Linspace(linspace=(first, last, count)):
            return list(_linspace(first, last, count))
        case Logspace(logspace=(first, last, count)):
            return list(_logspace(first, last, count))
        case Range(range=(first, last, step)):
            return list(_range(first, last, step))
        case Values(values=values):
            return list(values)
        case tuple():
            return list(axis)
        case _:
            raise TypeError(f"{type(axis).__name__} is sampled")


def points(sample: Sample, dimensions: int) -> NDArray[np.float64]:
    """Return (n, dimensions) points in the unit cube [0, 1)."""
    # Half a second to import, which sweeps without samples need not wait for.
    from scipy.stats import qmc  # noqa: PLC0415

    if sample.method == "random":
        return np.random.default_rng(sample.seed).random((sample.n, dimensions))
    if sample.method == "lhs":
        return qmc.LatinHypercube(dimensions, rng=sample.seed).random(sample.n)
    # The first n points of a Sobol sequence are the same however many are drawn.
    power = math.ceil(math.log2(sample.n)) if sample.n > 1 else 0
    return qmc.Sobol(dimensions, rng=sample.seed).random_base2(power)[: sample.n]


def drawn(axis: Uniform | Loguniform, spec: AxisSpec, units: NDArray[np.float64]) -> list[object]:
    """Return values for points in [0, 1); whole numbers where the axis takes no others."""
    low, high = axis.uniform if isinstance(axis, Uniform) else axis.loguniform
    whole = _takes_whole_only(spec, low, high)
    stop = high + 1 if whole else high
    if isinstance(axis, Uniform):
        scaled = low + units * (stop - low)
    else:
        scaled = np.exp(math.log(low) + units * (math.log(stop) - math.log(low)))
    return [_within(value, low, high, whole) for value in scaled.tolist()]


def _within(value: float, low: float, high: float, whole: bool) -> object:
    rounded = math.floor(value) if whole else _rounded(value)
    return min(max(rounded, low), high)


def _takes_whole_only(spec: AxisSpec, low: float, high: float) -> bool:
    """Tell whether an axis accepts its whole bounds, but not what lies between two of them."""
    if not (low.is_integer() and high.is_integer() and _accepts(spec.parse, low)):
        return False
    return not _accepts(spec.parse, low + 0.5)


def _accepts(parse: Callable[[object], object], value: float) -> bool:
    try:
        parse(value)
    except ValueError:
        return False
    return True


def _linspace(first: float, last: float, count: int) -> list[float]:
    start, end = _exact(first), _exact(last)
    return [_plain(start + (end - start) * Fraction(k, count - 1)) for k in range(count)]


def _logspace(first: float, last: float, count: int) -> list[float]:
    steps, low, high = count - 1, math.log(first), math.log(last)
    inner = [_rounded(math.exp(low + (high - low) * k / steps)) for k in range(1, steps)]
    return [_plain(_exact(value)) for value in (first, *inner, last)]


def _range(first: float, last: float, step: float) -> list[float]:
    start, end, stride = _exact(first), _exact(last), _exact(step)
    return [_plain(start + k * stride) for k in range((end - start) // stride + 1)]


def _exact(value: float) -> Fraction:
    """Return the decimal number that a value was written as."""
    return Fraction(Decimal(repr(value)))


def _plain(value: Fraction) -> float:
    return value.numerator if value.denominator == 1 else float(value)


def _rounded(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
