"""Rotations turn as the engine's do, and lose no digits."""

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.contact.rotations import (
    angles_between,
    rotate_vectors,
    rotate_vectors_back,
    rotation_from_x,
    rotation_matrices,
)
from contactlab.contact.trace_arrays import Floats


def unit(size: int) -> st.SearchStrategy[Floats]:
    part = st.floats(-1, 1, allow_subnormal=False)
    vectors = st.lists(part, min_size=size, max_size=size).map(np.array)
    long = vectors.filter(lambda vector: np.linalg.norm(vector) > 0.1)
    return long.map(lambda vector: vector / np.linalg.norm(vector))


UNIT = unit(4)


@given(rotation=UNIT, vector=unit(3))
def test_matrices_turn_as_quaternions_and_as_the_engine(rotation: Floats, vector: Floats) -> None:
    turned = np.zeros(3)
    mujoco.mju_rotVecQuat(turned, vector, rotation)
    assert rotate_vectors(rotation, vector) == pytest.approx(turned, abs=1e-14)
    assert rotation_matrices(rotation[None])[0] @ vector == pytest.approx(turned, abs=1e-14)


@given(st.lists(st.floats(-1, 1), min_size=7, max_size=7))
def test_turning_keeps_lengths_and_comes_back(numbers: list[float]) -> None:
    quaternion, vector = np.array([1.5, 0, 0, 0]) + numbers[:4], np.array(numbers[4:])
    quaternion /= np.linalg.norm(quaternion)
    there = rotate_vectors(quaternion, vector)
    assert np.linalg.norm(there) == pytest.approx(np.linalg.norm(vector), abs=1e-12)
    assert rotate_vectors_back(quaternion, there) == pytest.approx(vector, abs=1e-12)


def test_a_quarter_turn_about_z_takes_x_to_y() -> None:
    quarter = np.array([np.cos(np.pi / 4), 0, 0, np.sin(np.pi / 4)])
    assert rotate_vectors(quarter, np.array([1.0, 0, 0])) == pytest.approx([0, 1, 0], abs=1e-15)


@given(rotation=UNIT, axis=unit(3), angle=st.floats(1e-12, 3.1))
def test_angles_keep_their_digits(rotation: Floats, axis: Floats, angle: float) -> None:
    """A turn by a known angle about any axis is found again, be it ever so small."""
    turn = np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * axis])
    turned = np.zeros(4)
    mujoco.mju_mulQuat(turned, rotation, turn)
    # Products of numbers up to 1 are rounded to 1e-16 each, and an angle is twice their sum.
    found = angles_between(rotation[None], turned[None])
    assert found == pytest.approx(
        angle, rel=1e-12, abs=4e-15 + 2e-15 / max(1e-6, np.cos(angle / 2))
    )
    assert angles_between(rotation[None], -turned[None]) == pytest.approx(
        found, rel=1e-12, abs=1e-15
    )


@given(
    vector=st.tuples(*[st.floats(-1e3, 1e3)] * 3).filter(lambda each: np.linalg.norm(each) > 1e-6)
)
def test_the_x_axis_is_turned_into_any_direction(vector: tuple[float, float, float]) -> None:
    direction = np.array(vector) / np.linalg.norm(vector)
    quaternion = rotation_from_x(np.array(vector))
    assert abs(np.linalg.norm(quaternion) - 1) < 1e-15 * 4
    # The half angle's sum is at least 1, so that no digits are lost: a few roundings remain.
    np.testing.assert_allclose(
        rotate_vectors(quaternion, np.array([1.0, 0, 0])), direction, atol=4e-15
    )
