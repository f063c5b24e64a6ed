"""Orders and floors, from errors whose law is known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.pareto.convergence import (
    RULES,
    TimestepErrors,
    convergence_order,
    find_floor,
)

STEPS = 1e-4 * 2.0 ** np.arange(6)


def steps(error: np.ndarray, timestep: np.ndarray = STEPS, hidden: float = 0.0) -> TimestepErrors:
    return TimestepErrors(timestep, error, np.full(len(error), hidden))


@given(
    st.floats(0.5, 4.5), st.integers(0, 2**32 - 1), st.floats(1e-3, 1e3), st.sampled_from([3, 4, 6])
)
def test_the_order_of_a_power_law_with_noise(
    slope: float, seed: int, factor: float, count: int
) -> None:
    """Noise of up to 5 % in log error moves the slope over 3 steps by up to 0.1 / (2 ln 2) = 0.073.

    Over more steps it is less. The second difference of 3 steps is up to 0.2 then, and the standard
    error of their slope up to 0.2 / sqrt 6 / (ln 2 sqrt 2) = 0.084, so that an order is found.
    """
    noise = np.exp(np.random.default_rng(seed).uniform(-0.05, 0.05, count))
    found = convergence_order(steps(factor * STEPS[:count] ** slope * noise, STEPS[:count]))
    assert found.slope == pytest.approx(slope, abs=0.08)
    assert found.points >= 3


def test_an_exact_power_law_is_found_exactly() -> None:
    for slope in (1, 2, 4):
        found = convergence_order(steps(7 * STEPS**slope))
        assert found.slope == pytest.approx(slope, abs=1e-12)
        assert found.standard_error == pytest.approx(0, abs=1e-7)
        assert found.points == len(STEPS)


def test_coarse_steps_beyond_the_law_are_left_out() -> None:
    """An error saturates at the size of the motion; the fine steps still show the order."""
    error = STEPS**4 / (STEPS**4 + (1.6e-3) ** 4)
    found = convergence_order(steps(error))
    assert found.slope == pytest.approx(4, abs=0.2)
    assert 3 <= found.points < len(STEPS)


@given(st.integers(0, 2**32 - 1))
def test_a_slope_is_told_only_if_it_is_known(seed: int) -> None:
    error = np.exp(np.random.default_rng(seed).normal(0, 2, size=len(STEPS)))
    found = convergence_order(steps(error))
    if found.slope is None:
        assert found.reason
    else:
        assert found.standard_error is not None
        assert found.standard_error <= RULES.worst_standard_error
        assert found.slope >= 0.25


def test_scattered_errors_have_no_order() -> None:
    found = convergence_order(steps(np.array([1e-3, 5e-3, 2e-3, 9e-3, 1e-3, 4e-3])))
    assert found.slope is None
    assert "do not lie on a line" in str(found.reason)


def test_errors_near_the_references_own_do_not_count() -> None:
    """Below the estimate stands what the reference errs, which has another law."""
    estimate = 1e-9
    error = np.maximum(STEPS**2, estimate)
    clear = int((error > RULES.clear_ratio * estimate).sum())
    found = convergence_order(steps(error, hidden=estimate))
    assert found.points == clear >= 3
    assert found.slope == pytest.approx(2, abs=1e-12)
    none = convergence_order(steps(error, hidden=float(error[-2])))
    assert none.slope is None
    assert "timesteps have an error above three times the reference's" in str(none.reason)


def test_an_error_that_does_not_fall_has_no_order() -> None:
    found = convergence_order(steps(1e-3 * STEPS**0.02))
    assert found.slope is None
    assert "does not fall" in str(found.reason)


@given(st.floats(1e-6, 1.0), st.floats(0.7, 4), st.floats(1.0, 100.0))
def test_a_floor_is_found_under_a_power_law(floor: float, slope: float, above: float) -> None:
    """The error at the longest step is `above` floors more; what is found lies in the flat part.

    Where the error has risen by half the stretch ends, so that the median is within 1.5 floors.
    """
    error = floor * (1 + above * (STEPS / STEPS[-1]) ** slope)
    found = find_floor(steps(error))
    flat = error <= RULES.flat_ratio * error[0]
    if flat.sum() >= 3:
        assert found is not None
        assert found.points == flat.sum()
        assert floor <= found.error <= RULES.flat_ratio * error[0]
    else:
        assert found is None


@given(st.floats(0.5, 4), st.floats(1e-6, 1e3))
def test_a_power_law_has_no_floor(slope: float, factor: float) -> None:
    assert find_floor(steps(factor * STEPS**slope)) is None


def test_a_floor_spans_a_factor_of_four_in_timestep() -> None:
    """Three steps close together are nearly equal whatever the law."""
    near = 1e-3 * np.array([1.0, 1.1, 1.2])
    assert find_floor(steps(near, near)) is None
    wide = 1e-3 * np.array([1.0, 2.0, 4.0])
    assert find_floor(steps(np.full(3, 0.5), wide)) is not None


def test_above_a_floor_the_order_needs_three_clear_steps() -> None:
    floor = 1e-3
    found = convergence_order(steps(floor + 1e2 * STEPS**2), floor)
    assert found.slope is None
    assert "0 of at least 3 timesteps have an error above three times the floor" in str(
        found.reason
    )
