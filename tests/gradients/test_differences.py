"""Derivatives by differences lie within their own bound: of smooth, noisy and jumping values."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.contact.trace_arrays import Floats
from contactlab.studies.gradients.differences import (
    PLAN,
    Estimate,
    estimate_noise,
    extrapolate,
    fit_slope,
    ladder_points,
)

ULP = float(np.finfo(float).eps)


def of_sine(at: float, noise: Floats | float = 0.0) -> Estimate:
    """Return the derivative of a sine, to whose values an error is added."""
    points = np.concatenate([ladder_points(at), at + PLAN.noise_offsets])
    values = np.sin(points) + noise
    rungs = slice(2 * len(PLAN.spans))
    return extrapolate(points[rungs], values[rungs], estimate_noise(values[rungs.stop :]))


def least_bound(size: float) -> float:
    """Return what the bound of a sine's derivative stays below, given the size of errors.

    It is s^2 / (6 r^2) + 4.1 N / s, with r = 3.7, least at s^3 = 167 N, where it is 1.1 N^(2/3).
    The spans of the ladder miss that by up to sqrt(r), which costs 1.6; the first part, as it is
    measured, has once more the second; N is at most 5 sizes, which to 2/3 are 2.9.
    """
    return 2 * 1.6 * 1.1 * 2.9 * size ** (2 / 3) * 1.2


@given(at=st.floats(0.1, 3))
def test_a_smooth_derivative_is_within_its_bound(at: float) -> None:
    found = of_sine(at)
    assert abs(found.value - math.cos(at)) <= found.bound
    assert found.bound < least_bound(ULP)


@pytest.mark.parametrize("size", [1e-12, 1e-9, 1e-6])
def test_noise_is_seen_and_bounded(size: float) -> None:
    """Uniform errors of a size: four deviations of it are 2.3 sizes, more than any error is.

    The deviation is estimated from seven values, by the greatest of three orders: a half of the
    truth, which would let an error out, has a chance below 1e-3; the sum with the distance of two
    extrapolations covers that.
    """
    for seed in range(50):
        rng = np.random.default_rng(seed)
        count = 2 * len(PLAN.spans) + len(PLAN.noise_offsets)
        found = of_sine(0.3, rng.uniform(-size, size, count))
        assert abs(found.value - math.cos(0.3)) <= found.bound
        assert found.bound < least_bound(size)


@pytest.mark.parametrize("beside", [1e-4, 1e-3, 1e-2])
def test_a_kink_beside_is_not_mixed_in(beside: float) -> None:
    """The slope at the point is 1, beyond the kink 3: spans that reach it tell neither."""
    points = np.concatenate([PLAN.spans, -PLAN.spans])
    found = extrapolate(points, points + 2 * np.maximum(points - beside, 0), noise=ULP)
    assert abs(found.value - 1) <= found.bound
    assert found.span < 2 * beside


def test_a_point_on_a_jump_has_no_derivative() -> None:
    points = np.concatenate([PLAN.spans, -PLAN.spans])
    found = extrapolate(points, np.sign(points), noise=ULP)
    assert found.bound > 1


def sawtooth(points: Floats, tooth: float, phases: Floats) -> Floats:
    """Return values that rise by 2 for each unit, but for jumps back in teeth of a width."""
    return np.sin(2 * points) + 10 * (np.mod(points / tooth + phases, 1) - 0.5) * tooth


@pytest.mark.parametrize("tooth", [1e-3, 4e-3, 1e-2])
def test_smoothing_sees_through_teeth(tooth: float) -> None:
    """A run's slope is 2 + 10 within a tooth; the model's, teeth going to 0, is 2 at 0."""
    points = PLAN.wide_spans[:, None] * PLAN.within
    for seed in range(50):
        rng = np.random.default_rng(seed)
        fine, coarse = (
            sawtooth(points, width, rng.uniform(0, 1, points.shape)) for width in (tooth, 2 * tooth)
        )
        found = fit_slope(PLAN.wide_spans, fine, coarse)
        assert abs(found.value - 2) <= found.bound
        assert found.bound < 1


def test_runs_that_failed_give_none() -> None:
    points = ladder_points(1.0)
    assert math.isinf(extrapolate(points, np.full(len(points), np.nan), math.nan).bound)
    wide = np.full((len(PLAN.wide_spans), len(PLAN.within)), np.nan)
    assert math.isinf(fit_slope(PLAN.wide_spans, wide, wide).bound)
