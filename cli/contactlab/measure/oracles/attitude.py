"""Vectors between a body's axes and the world's."""

import numpy as np

from contactlab.contact import Floats


def to_world(quaternion: Floats, vector: Floats) -> Floats:
    """Return vectors (..., 3) given along a body's axes in the world's frame.

    Args:
        quaternion: (..., 4) the body's attitude, w first.
        vector: (..., 3).
    """
    w, axis = quaternion[..., :1], quaternion[..., 1:]
    turn = 2 * np.cross(axis, vector)
    return vector + w * turn + np.cross(axis, turn)


def to_body(quaternion: Floats, vector: Floats) -> Floats:
    """Return vectors (..., 3) of the world's frame along a body's axes, as in `to_world`."""
    return to_world(quaternion * np.array([1.0, -1.0, -1.0, -1.0]), vector)
