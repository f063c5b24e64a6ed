"""Refining a grid finds what running all of it finds, and says what it may have missed."""

from fractions import Fraction
from itertools import pairwise
from math import comb

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import binom

from contactlab.plan.refinement import (
    UNKNOWN,
    Codes,
    corners_of,
    group_lattices,
    halve_cells,
    infer_codes,
    miss_probability,
    next_points,
    smallest_detected_island,
)
from contactlab.plan.sides import side_of

TO, STRIDE = 17, 4
Ranks = NDArray[np.intp]
ANGLES = st.floats(0, 2 * np.pi)


def half_plane(angle: float, offset: float, to: int = TO) -> Codes:
    """Return the grid of a boundary that is a straight line."""
    x, y = np.mgrid[:to, :to] / (to - 1) - 0.5
    return (np.cos(angle) * x + np.sin(angle) * y > offset).astype(np.int32)


def refined(truth: Codes, probe: float = 0.0, ranks: Ranks | None = None, most: int = 0) -> Codes:
    """Return what is known in the end, if `most` runs finish at a time; all of a round if 0."""
    order = np.arange(truth.size, dtype=np.intp).reshape(truth.shape) if ranks is None else ranks
    codes = np.full(truth.shape, UNKNOWN, np.int32)
    while (wanted := next_points(codes, STRIDE, probe, order)).any():
        assert (codes[wanted] == UNKNOWN).all()
        taken = np.flatnonzero(wanted)[: most or None]
        codes.flat[taken] = truth.flat[taken]
    return codes


def inferred(codes: Codes) -> Codes:
    return infer_codes(codes, halve_cells(codes, STRIDE).cells)


@given(angle=ANGLES, offset=st.floats(-0.6, 0.6))
def test_a_straight_boundary_is_found_with_no_cell_wrong(angle: float, offset: float) -> None:
    """A half-plane that holds a point of a box holds one of its corners.

    Any linear function takes its largest value there: so cells with equal corners are uniform.
    """
    truth = half_plane(angle, offset)
    codes = refined(truth)
    assert np.array_equal(inferred(codes), truth)
    for cell in halve_cells(codes, STRIDE).cells:
        assert len(np.unique(truth[cell.box])) == 1 or cell.steps == 1


def test_a_cube_of_three_axes() -> None:
    """As in the plane."""
    x, y, z = np.mgrid[:9, :9, :9]
    truth = (x + 2 * y - z > 7).astype(np.int32)
    codes = refined(truth)
    assert np.array_equal(inferred(codes), truth)
    assert (codes == UNKNOWN).sum() > 0.3 * truth.size


@pytest.mark.parametrize("place", range(1, TO))
def test_one_axis_is_bisected(place: int) -> None:
    """Of a coarse grid of 5, one gap of 4 is halved twice: two runs more."""
    truth = (np.arange(TO) >= place).astype(np.int32)
    codes = refined(truth)
    assert np.array_equal(inferred(codes), truth)
    assert (codes != UNKNOWN).sum() <= 5 + 3
    assert any(codes[step] == 0 and codes[step + 1] == 1 for step in range(TO - 1))


@given(
    truth=st.lists(st.integers(0, 2), min_size=81, max_size=81),
    most=st.integers(5, 30),
    probe=st.sampled_from([0.0, 0.2]),
)
def test_neither_interruption_nor_order_changes_what_runs(
    truth: list[int], most: int, probe: float
) -> None:
    """Any outcomes, even those without a boundary."""
    whole = np.array(truth, np.int32).reshape(9, 9)
    at_once, by_few = refined(whole, probe), refined(whole, probe, most=most)
    assert np.array_equal(at_once, by_few)
    # What is known besides does not either.
    known = np.where(at_once == UNKNOWN, UNKNOWN, at_once)
    known[0, :] = whole[0, :]
    assert not next_points(known, STRIDE, probe, np.arange(81).reshape(9, 9)).any()


def test_a_probe_that_differs_halves_its_cell() -> None:
    """An island within one cell, whose every point is a probe: it is found to its last point."""
    truth = np.zeros((TO, TO), np.int32)
    truth[5:7, 9:12] = 1
    codes = refined(truth, probe=1.0, ranks=np.argsort(-truth, axis=None).argsort().reshape(TO, TO))
    assert np.array_equal(inferred(codes), truth)
    assert (refined(truth) != 1).all()


@pytest.mark.parametrize(
    "side", [1, pytest.param(2, marks=pytest.mark.long), pytest.param(4, marks=pytest.mark.long)]
)
def test_islands_are_missed_as_often_as_is_said(side: int) -> None:
    """Of 200 lattices with an island of 1, 4 and 16 points, each with its own draw of probes.

    The number of misses is binomial; its bounds are those that one in 10^4 such tests exceeds.
    """
    truth = np.zeros((33, 33), np.int32)
    truth[9 : 9 + side, 17 : 17 + side] = 1
    # A larger share than usual, so that islands of one point are met at all.
    share, times, stride = 2.0, 200, 8
    points = truth.size - 25
    said = miss_probability(points, 2 * 25, side**2)
    # Those that lie on corners of the first cells would be met anyhow.
    assert not truth[::stride, ::stride].any()
    misses = 0
    for seed in range(times):
        ranks = np.random.default_rng(seed).permutation(truth.size).reshape(truth.shape)
        codes = np.full(truth.shape, UNKNOWN, np.int32)
        while (wanted := next_points(codes, stride, share, ranks)).any():
            codes[wanted] = truth[wanted]
        misses += not (codes == 1).any()
    low, high = binom.interval(1 - 1e-4, times, said)
    assert low <= misses <= high


@given(points=st.integers(1, 300), probes=st.integers(0, 300), island=st.integers(0, 300))
def test_the_chance_of_missing_an_island_is_hypergeometric(
    points: int, probes: int, island: int
) -> None:
    """Of up to 300 factors, the rounding of each logarithm (2^-53) adds up to some 1e-13."""
    probes, island = min(probes, points), min(island, points)
    exact = Fraction(comb(points - island, probes), comb(points, probes))
    assert miss_probability(points, probes, island) == pytest.approx(float(exact), rel=1e-11)


@given(points=st.integers(1, 300), probes=st.integers(1, 300))
def test_the_least_island_that_is_met(points: int, probes: int) -> None:
    probes = min(probes, points)
    least = smallest_detected_island(points, probes)
    assert least is not None
    # Up to rounding, which decides where a chance is 1 in 20.
    assert miss_probability(points, probes, least) <= 0.05 * (1 + 1e-11)
    assert least == 1 or miss_probability(points, probes, least - 1) > 0.05 * (1 - 1e-11)


def test_corners_of_cells_are_what_halving_asked_for() -> None:
    """Without probes, nothing else runs."""
    codes = refined(half_plane(0.7, 0.1))
    cells = halve_cells(codes, STRIDE).cells
    assert np.array_equal(corners_of(cells, codes.shape), codes != UNKNOWN)
    area = sum(cell.steps**2 for cell in cells)
    assert area == (TO - 1) ** 2


def test_lattices_part_what_other_axes_and_seeds_tell_apart() -> None:
    axes = {"a": (1.0, 2.0), "b": (3.0, 4.0)}
    runs = [
        (2 * place + seed, {"a": a, "c": c, "b": b}, seed)
        for place, (a, b, c) in enumerate(
            (a, b, c) for a in (1.0, 2.0) for b in (3.0, 4.0) for c in "xy"
        )
        for seed in (0, 1)
    ]
    found = group_lattices([*runs, (99, {"a": 7.0, "b": 3.0, "c": "x"}, 0)], axes)
    assert len(found) == 4
    places = np.sort(np.concatenate([lattice.places.ravel() for lattice in found]))
    assert np.array_equal(places, np.arange(16))
    ranks = [lattice.ranks for lattice in found]
    assert all(np.array_equal(np.sort(one.ravel()), np.arange(4)) for one in ranks)
    assert {(lattice.shared["c"], lattice.seed) for lattice in found} == {
        (word, seed) for word in "xy" for seed in (0, 1)
    }


@pytest.mark.parametrize(
    ("where", "row", "side"),
    [
        ("label", {"label": "slip", "labels": ["slip"]}, "slip"),
        ("outcome", {"label": "slip", "labels": ["slip"]}, False),
        ("outcome", {"label": "stable", "labels": ["stable"]}, True),
        ("must", {"label": "slip", "labels": ["slip"]}, True),
        ("must", {"label": "slip", "labels": ["slip", "dropped"]}, False),
        ("slip > 1mm", {"slip": 0.0011}, True),
        ("slip > 1 mm", {"slip": 0.0009}, False),
        ("slip > 1mm and share < 10%", {"slip": 0.0011, "share": 0.09}, True),
        ("slip > 1e-3", {"slip": None}, None),
    ],
)
def test_sides(where: str, row: dict[str, object], side: object) -> None:
    assert side_of(where, frozenset({"dropped"}))(row) == side


def test_first_cells_of_a_grid_lie_side_by_side() -> None:
    codes = np.full(9, UNKNOWN, np.int32)
    cells = sorted(halve_cells(codes, 4).cells)
    assert [cell.steps for cell in cells] == [4, 4]
    assert all(one.origin[0] + one.steps == other.origin[0] for one, other in pairwise(cells))
