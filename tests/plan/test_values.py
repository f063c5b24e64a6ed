"""Axis forms: ends, spacing, bounds and repetition."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from contactlab.plan.rows import listed_values, sample_points, sampled_values
from contactlab.schema.sweep_schema import Sample
from contactlab.schema.vocabulary import AxisSpec, Linspace, Logspace, Loguniform, Range, Uniform

# Down to 1e-290: below 1e-308 numbers lose digits, and a unit in the last place is no measure.
finite = (
    st.floats(-1e6, 1e6)
    .map(lambda value: float(f"{value:.6g}"))
    .filter(lambda value: value == 0 or abs(value) > 1e-290)
)
positive = st.floats(1e-9, 1e9)
METHODS = st.sampled_from(["sobol", "lhs", "random"])


def real(value: object) -> float:
    return float(str(value))


def whole(value: object) -> int:
    if real(value) != math.floor(real(value)):
        raise ValueError("write a whole number")
    return int(real(value))


REAL = AxisSpec("friction.slide", "1", "sliding friction", real)
WHOLE = AxisSpec("iterations", "1", "solver iterations", whole)


@given(finite, finite, st.integers(2, 50))
def test_linspace_holds_both_ends_exactly(first: float, last: float, count: int) -> None:
    values = [real(value) for value in listed_values(Linspace(linspace=(first, last, count)))]
    assert (values[0], values[-1], len(values)) == (first, last, count)
    # One rounding each: at most half a unit in the last place of the larger end, and twice that
    # for what NumPy computes in floats.
    bound = 4 * np.spacing(max(abs(first), abs(last)))
    np.testing.assert_allclose(values, np.linspace(first, last, count), rtol=0, atol=bound)


@given(positive, positive, st.integers(2, 50))
def test_logspace_holds_both_ends_exactly(first: float, last: float, count: int) -> None:
    values = [real(value) for value in listed_values(Logspace(logspace=(first, last, count)))]
    assert (values[0], values[-1], len(values)) == (first, last, count)
    # Rounded to 12 digits, so off by at most 5e-12 of its size.
    np.testing.assert_allclose(values, np.geomspace(first, last, count), rtol=6e-12)


@given(
    st.integers(-1000, 1000),
    st.integers(1, 500),
    st.integers(1, 60),
    st.sampled_from([1, 10, 100, 1000]),
    st.booleans(),
)
def test_range_counts_in_decimal_steps(
    start: int, step: int, count: int, scale: int, down: bool
) -> None:
    sign = -1 if down else 1
    expected = [(start + sign * step * k) / scale for k in range(count)]
    form = Range(range=(expected[0], expected[-1], sign * step / scale))
    # The quotient of two integers is correctly rounded, and so is the exact decimal.
    assert [real(value) for value in listed_values(form)] == expected


def test_range_stops_before_an_end_that_the_steps_miss() -> None:
    assert listed_values(Range(range=(0, 1, 0.3))) == [0, 0.3, 0.6, 0.9]
    assert listed_values(Range(range=(0, 0.3, 0.1))) == [0, 0.1, 0.2, 0.3]


@given(METHODS, st.integers(1, 70), st.integers(1, 5), st.integers(0, 2**62))
def test_samples_repeat_and_fill_the_unit_cube(
    method: str, n: int, dimensions: int, seed: int
) -> None:
    sample = Sample.model_validate({"method": method, "n": n, "seed": seed})
    first, again = sample_points(sample, dimensions), sample_points(sample, dimensions)
    assert first.shape == (n, dimensions)
    assert np.array_equal(first, again)
    assert ((first >= 0) & (first < 1)).all()


def test_latin_hypercube_has_one_point_a_stratum() -> None:
    cube = sample_points(Sample(method="lhs", n=12), 3)
    assert all(sorted(np.floor(column * 12)) == list(range(12)) for column in cube.T)


def test_sobol_has_one_point_a_stratum() -> None:
    cube = sample_points(Sample(method="sobol", n=16), 3)
    assert all(sorted(np.floor(column * 16)) == list(range(16)) for column in cube.T)


def test_more_sobol_points_begin_with_the_fewer() -> None:
    few, many = sample_points(Sample(n=5), 2), sample_points(Sample(n=100), 2)
    assert np.array_equal(few, many[:5])


@given(METHODS, st.integers(1, 40), finite, finite)
def test_uniform_stays_in_bounds(method: str, n: int, low: float, high: float) -> None:
    assume(low < high)
    units = sample_points(Sample.model_validate({"method": method, "n": n}), 1)[:, 0]
    values = [real(value) for value in sampled_values(Uniform(uniform=(low, high)), REAL, units)]
    assert all(low <= value <= high for value in values)


@given(st.integers(1, 40), positive, positive)
def test_loguniform_stays_in_bounds(n: int, low: float, high: float) -> None:
    assume(low < high)
    units = sample_points(Sample(n=n), 1)[:, 0]
    values = [
        real(value) for value in sampled_values(Loguniform(loguniform=(low, high)), REAL, units)
    ]
    assert all(low <= value <= high for value in values)


def test_loguniform_is_even_in_its_logarithm() -> None:
    units = np.array([0.0, 0.25, 0.5, 0.75])
    assert sampled_values(Loguniform(loguniform=(1e-4, 1)), REAL, units) == [1e-4, 1e-3, 1e-2, 1e-1]


def test_a_whole_axis_gets_every_whole_number_alike() -> None:
    units = np.linspace(0, 1, 400, endpoint=False)
    values = sampled_values(Uniform(uniform=(1, 4)), WHOLE, units)
    assert [values.count(number) for number in (1, 2, 3, 4)] == [100] * 4
    assert all(isinstance(value, int) for value in values)


def test_a_real_axis_with_whole_bounds_is_not_rounded() -> None:
    assert sampled_values(Uniform(uniform=(0, 1)), REAL, np.array([0.25, 0.5])) == [0.25, 0.5]


@pytest.mark.parametrize("ends", [(1, 5, 5), (5, 1, 5)])
def test_whole_values_stay_whole(ends: tuple[int, int, int]) -> None:
    values = listed_values(Linspace(linspace=ends))
    assert all(isinstance(value, int) for value in values)
    assert {abs(real(b) - real(a)) for a, b in pairwise(values)} == {1}
