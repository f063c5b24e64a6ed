"""Tests of numerical tolerances: each level admits the rounding that it is for, and little more."""

import numpy as np
import pytest

from contactlab.numerical_tolerance import COARSE_ROUNDING, ROUNDING, SUM_ROUNDING

STEPS = (0.01, 0.002, 0.001, 1 / 240)
EPS = float(np.finfo(float).eps)


@pytest.mark.parametrize("step", STEPS)
def test_a_sum_of_steps_is_within_the_levels_of_sums(step: float) -> None:
    """A time may be off by half an ulp of the sum in each step: count * eps / 4 of itself."""
    times = np.cumsum(np.full(1_000_000, step))
    assert abs(times[-1] / (1_000_000 * step) - 1) <= 1_000_000 * EPS / 4 < SUM_ROUNDING
    steps = times[:100_000] / step
    bound = 100_000**2 * EPS / 4
    assert np.abs(steps - np.arange(1, 100_001)).max() <= bound < COARSE_ROUNDING


def test_a_norm_is_within_the_level_of_some_operations() -> None:
    units = np.random.default_rng(0).normal(size=(1000, 4))
    units /= np.linalg.norm(units, axis=1, keepdims=True)
    off = np.abs(np.linalg.norm(units, axis=1) - 1).max()
    assert 0 < off < 16 * EPS < ROUNDING


def test_single_precision_is_coarse_rounding() -> None:
    values = np.random.default_rng(0).uniform(0.1, 10, 1000)
    off = np.abs(values.astype(np.float32) / values - 1).max()
    assert SUM_ROUNDING < off < COARSE_ROUNDING


def test_text_of_seven_digits_is_coarse_rounding() -> None:
    values = np.random.default_rng(0).uniform(0.1, 10, 1000)
    off = max(abs(float(f"{value:.7g}") / value - 1) for value in values)
    assert SUM_ROUNDING < off < COARSE_ROUNDING


def test_redundant_rows_are_found_by_the_level_of_factorizations() -> None:
    """Rows of masses that differ by a million have their rank, with a row that repeats a sum."""
    rows = np.random.default_rng(0).normal(size=(6, 12)) * np.array([[1, 10, 1, 1e3, 1e6, 1]]).T
    rows = np.vstack([rows, rows[0] + rows[4]])
    sizes = np.linalg.svd(rows, compute_uv=False)
    assert (sizes > SUM_ROUNDING * sizes.max()).sum() == 6
