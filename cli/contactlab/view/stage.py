"""The part of space that is worth looking at, and how long arrows are in it."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import BodyShape, Floats, Form

# Beyond so many radii of the largest moving body, that body would be a dot.
_WIDEST = 25.0
# Nine in ten forces are drawn at most about as long as the first share of the radius; arrows are
# cut at the second.
_USUAL, _LONGEST = 0.5, 1.0
_MOST = 90


def stage(
    shapes: Sequence[BodyShape], moving: NDArray[np.bool_], positions: Floats, contacts: Floats
) -> tuple[Floats, float]:
    """Return centre and radius [m] of a sphere around all that moves, or around the contacts.

    Args:
        shapes: the bodies' shapes.
        moving: (B,) whether each body can move.
        positions: (F, B, 3) of the bodies [m].
        contacts: (K, 3) contact points [m].
    """
    reach = _reach(shapes, len(moving))
    seen = (moving if moving.any() else np.ones_like(moving)) & (reach > 0)
    if not seen.any():
        return np.zeros(3), 1.0
    low = (positions[:, seen] - reach[seen, None]).min(axis=(0, 1))
    high = (positions[:, seen] + reach[seen, None]).max(axis=(0, 1))
    centre = (low + high) / 2
    far = np.linalg.norm(positions[:, seen] - centre, axis=2) + reach[seen]
    radius = float(far.max())
    widest = _WIDEST * float(reach[seen].max())
    if radius <= widest:
        return centre, radius
    middle = contacts if len(contacts) else positions[0, seen]
    return np.median(middle, axis=0), widest


def arrow_scale(force: Floats, radius: float) -> tuple[float, float]:
    """Return an arrow's length for a newton [m/N], of first digit 1, 2 or 5, and the longest [m].

    Args:
        force: (K, 3) contact forces [N].
        radius: of the stage [m].
    """
    strength = np.linalg.norm(force, axis=1)
    pushing = strength[strength > 0]
    usual = float(np.percentile(pushing, _MOST)) if len(pushing) else 1.0
    wanted = _USUAL * radius / usual
    decade = 10.0 ** np.floor(np.log10(wanted))
    digit = min((1, 2, 5, 10), key=lambda each: abs(np.log10(each * decade / wanted)))
    return float(digit * decade), _LONGEST * radius


def _reach(shapes: Sequence[BodyShape], bodies: int) -> Floats:
    """Return (B,) the radius around each body's origin that holds its shapes [m]."""
    reach = np.zeros(bodies)
    for shape in shapes:
        far = np.linalg.norm(shape.size) / 2
        if shape.form is Form.mesh:
            far = np.linalg.norm(shape.vertices, axis=1).max(initial=0)
        elif shape.form is Form.ellipsoid:
            far = shape.size.max() / 2
        reach[shape.body] = max(reach[shape.body], np.linalg.norm(shape.position) + far)
    return reach
