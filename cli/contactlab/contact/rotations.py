"""Rotations as unit quaternions w, x, y, z, as in MuJoCo; NumPy only.

A body's quaternion turns vectors given along the body's axes into the world frame.
"""

import numpy as np

from contactlab.contact.trace_arrays import Floats


def rotate_vectors(quaternion: Floats, vector: Floats) -> Floats:
    """Return vectors (..., 3) turned by quaternions (..., 4): body to world."""
    scalar, a, b, c = (quaternion[..., place] for place in range(4))
    x, y, z = (vector[..., place] for place in range(3))
    # Cross products by components, because NumPy's takes three times as long.
    p, q, r = 2 * (b * z - c * y), 2 * (c * x - a * z), 2 * (a * y - b * x)
    turned = np.empty((*np.shape(scalar + x), 3))
    turned[..., 0] = x + scalar * p + (b * r - c * q)
    turned[..., 1] = y + scalar * q + (c * p - a * r)
    turned[..., 2] = z + scalar * r + (a * q - b * p)
    return turned


def rotate_vectors_back(quaternion: Floats, vector: Floats) -> Floats:
    """Return vectors (..., 3) turned by the inverses of quaternions (..., 4): world to body."""
    return rotate_vectors(quaternion * np.array([1.0, -1.0, -1.0, -1.0]), vector)


def multiply_rotations(first: Floats, second: Floats) -> Floats:
    """Return rotations (..., 4) that turn by the second, then by the first."""
    one, two = first[..., 1:], second[..., 1:]
    real = first[..., :1] * second[..., :1] - (one * two).sum(axis=-1, keepdims=True)
    imaginary = first[..., :1] * two + second[..., :1] * one + np.cross(one, two)
    return np.concatenate([real, imaginary], axis=-1)


def rotation_matrices(quaternions: Floats) -> Floats:
    """Return (N, 3, 3) matrices, body to world, of quaternions (N, 4)."""
    scalar, axis = quaternions[:, 0], quaternions[:, 1:]
    zero = np.zeros_like(scalar)
    x, y, z = axis.T
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    return np.eye(3) + 2 * (scalar[:, None, None] * cross + cross @ cross)


def angles_between(first: Floats, second: Floats) -> Floats:
    """Return (T,) angles [rad], at most pi, between rotations (T, 4); q and -q are the same.

    The angle comes from both parts of conj(first) * second, so that neither tiny angles nor norms
    slightly off 1 cost digits.
    """
    scalar, vector = first[:, 0], first[:, 1:]
    other_scalar, other = second[:, 0], second[:, 1:]
    real = scalar * other_scalar + (vector * other).sum(axis=1)
    imaginary = scalar[:, None] * other - other_scalar[:, None] * vector - np.cross(vector, other)
    return 2 * np.arctan2(np.linalg.norm(imaginary, axis=1), np.abs(real))


def rotation_from_x(vector: Floats) -> Floats:
    """Return (4,) a rotation that turns +x into the direction of a vector (3,)."""
    length = np.linalg.norm(vector)
    x, y, z = vector / length if length else (1.0, 0.0, 0.0)
    # Use the half angle; towards -x, after half a turn about z, because the first form vanishes.
    turn = np.array([1 + x, 0.0, -z, y] if x >= 0 else [y, z, 0.0, 1 - x])
    return turn / np.linalg.norm(turn)
