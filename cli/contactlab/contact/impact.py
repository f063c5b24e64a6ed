"""Impact of a point mass by impulse: restitution along the normal, Coulomb friction across it.

An impulse J changes the velocity of a mass m by J / m at once. Along the unit normal n, away from
the surface, Newton's law of restitution asks for ``v_n' = -e v_n``, so that

    J_n = m (v_n' - v_n) = -(1 + e) m v_n,        which is positive for an approach, v_n < 0.

Across it, the impulse that would end all sliding is ``-m v_t``. Friction can give at most mu J_n
(Coulomb's law, integrated over the impact while the slip keeps its direction). If that is enough
the mass sticks, ``J_t = -m v_t``; else it slides on, and the impulse lies on the boundary of the
cone, against the slip: ``J_t = -mu J_n v_t / |v_t|``. The two meet where

    |v_t| = mu (1 + e) |v_n|,

a cone in velocity space. A point mass has no rotation, so nothing reverses within the impact.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contactlab.contact import Floats


@dataclass(frozen=True)
class Impact:
    """What n impacts do.

    Attributes:
        velocity: (n, d) velocity afterwards [m/s].
        impulse: (n, d) impulse on the mass [N s].
        normal_impulse: (n,) its part along the normal [N s].
        tangential_impulse: (n,) magnitude of its part across the normal [N s].
        sticks: (n,) whether the impulse is inside the cone; False where it lies on the boundary.
    """

    velocity: Floats
    impulse: Floats
    normal_impulse: Floats
    tangential_impulse: Floats
    sticks: NDArray[np.bool_]


def resolve_impact(
    mass: ArrayLike,
    velocity: ArrayLike,
    normal: ArrayLike,
    restitution: ArrayLike,
    friction: ArrayLike,
) -> Impact:
    """Return what impacts do; a mass that moves away from the surface gets no impulse.

    Args:
        mass: (n,) or one [kg].
        velocity: (n, d) before the impact, d being 2 or 3 [m/s].
        normal: (n, d) or (d,), away from the surface, of any length.
        restitution: (n,) or one, in [0, 1].
        friction: (n,) or one, at least 0.
    """
    before = np.atleast_2d(np.asarray(velocity, dtype=np.float64))
    away = np.asarray(normal, dtype=np.float64)
    away = away / np.linalg.norm(away, axis=-1, keepdims=True)
    speed = (before * away).sum(axis=-1)
    slip = before - speed[:, None] * away
    normal_impulse = np.asarray(mass) * (1 + np.asarray(restitution)) * np.maximum(-speed, 0)
    ending = np.asarray(mass) * np.linalg.norm(slip, axis=-1)
    bound = np.asarray(friction) * normal_impulse
    tangential = np.minimum(ending, bound)
    share = np.divide(tangential, ending, out=np.zeros_like(ending), where=ending > 0)
    weight = np.broadcast_to(np.asarray(mass, dtype=np.float64), speed.shape)[:, None]
    impulse = normal_impulse[:, None] * away - share[:, None] * weight * slip
    return Impact(
        velocity=before + impulse / weight,
        impulse=impulse,
        normal_impulse=normal_impulse,
        tangential_impulse=tangential,
        sticks=ending <= bound,
    )


def sticking_speed(normal_speed: ArrayLike, restitution: ArrayLike, friction: ArrayLike) -> Floats:
    """Return the largest tangential speed [m/s] that an impact at a normal speed [m/s] stops."""
    approach = np.abs(np.asarray(normal_speed, dtype=np.float64))
    return np.asarray(friction) * (1 + np.asarray(restitution)) * approach
