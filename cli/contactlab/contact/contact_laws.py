"""Closed forms of contact: MuJoCo's soft contact at impact and at rest, and rigid impacts.

Along the normal, penetration r of a contact with constant impedance d obeys
``r'' = -B r' - K r + (1 - d) a``, with the force clipped at zero. So K [1/s^2] is a stiffness and
B [1/s] a damping, both per unit of effective mass, and a is the acceleration without the contact.
Source: MuJoCo's documentation, Computation, "Parameters"; solved for impact and for rest.
"""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contactlab.contact.trace_arrays import Floats

IMPEDANCE_RANGE = (1e-4, 0.9999)
"""MuJoCo clips an impedance to these bounds."""
_REFSAFE_STEPS = 2
STABLE_STEP, RESOLVED_STEP = 0.8, 0.2
"""Largest steps, times sqrt(K), without energy gain in impacts, and with accurate restitution."""


def stiffness_damping(solref: ArrayLike) -> tuple[Floats, Floats]:
    """Return (K [1/s^2], B [1/s]) of solref (..., 2) in either form.

    The standard form is (time constant [s], damping ratio), both positive; the direct form is
    (-K, -B).
    """
    first, second = np.moveaxis(np.asarray(solref, dtype=np.float64), -1, 0)
    direct = first <= 0
    constant = np.where(direct, 1.0, first)
    ratio = np.where(direct, 1.0, second)
    stiffness = np.where(direct, -first, 1 / (constant * ratio) ** 2)
    return stiffness, np.where(direct, -second, 2 / constant)


def refsafe_solref(solref: tuple[float, ...], timestep: float) -> tuple[float, ...]:
    """Return a solref under refsafe: with a time constant [s] of at least two timesteps [s]."""
    return (max(solref[0], _REFSAFE_STEPS * timestep), solref[1]) if solref[0] > 0 else solref


def largest_step(solref: tuple[float, ...]) -> float:
    """Return the largest timestep [s] that resolves a solref: stable, and unchanged by refsafe."""
    stable = STABLE_STEP / float(np.sqrt(stiffness_damping(solref)[0]))
    return min(stable, solref[0] / _REFSAFE_STEPS) if solref[0] > 0 else stable


def damping_ratio(solref: ArrayLike) -> Floats:
    """Return zeta = B / (2 sqrt K) of solref (..., 2); infinite without stiffness."""
    stiffness, damping = stiffness_damping(solref)
    rate = np.sqrt(np.maximum(stiffness, 0))
    undriven = rate == 0
    return np.where(undriven, np.inf, damping / (2 * np.where(undriven, 1, rate)))


def restitution_from_damping(zeta: ArrayLike) -> Floats:
    """Return the ratio of rebound to approach speed for damping ratio zeta >= 0, without gravity.

    The force pushes only: the bodies part when it would turn to pull, which is before the
    oscillator is back at zero. So ``e = exp(-2 zeta acos(zeta) / sqrt(1 - zeta^2))``, with acosh
    and ``zeta^2 - 1`` above 1, and e = exp(-2) at 1.
    """
    zeta = np.asarray(zeta, dtype=np.float64)
    cosine = np.minimum(zeta, 1)
    sine = np.sqrt((1 - cosine) * (1 + cosine))
    below = np.where(sine > 0, np.arctan2(sine, cosine) / np.where(sine > 0, sine, 1), 1)
    secant = np.maximum(zeta, 1)
    slope = np.sqrt(1 - secant**-2)
    above = np.where(slope > 0, np.arccosh(secant) / np.where(slope > 0, slope, 1), 1)
    return np.where(zeta <= 1, np.exp(-2 * cosine * below), np.exp(-2 * above))


def damping_ratio_of(restitution: ArrayLike) -> Floats:
    """Return the zeta with a given `restitution_of`.

    Raises a ValueError unless each is in (0, 1].
    """
    target = np.asarray(restitution, dtype=np.float64)
    if not np.all((target > 0) & (target <= 1)):
        raise ValueError(f"restitution must be above 0 and at most 1, not {restitution}")
    # e < 1 / zeta^2 everywhere, so the root lies below 1 / sqrt(e).
    return _bisect_root(
        np.zeros_like(target),
        1 / np.sqrt(target),
        lambda zeta: restitution_from_damping(zeta) > target,
    )


def _bisect_root(
    low: Floats, high: Floats, is_below: Callable[[Floats], NDArray[np.bool_]]
) -> Floats:
    """Return the values between two bounds from where `is_below` is false."""
    bisections = 60
    for _ in range(bisections):
        middle = (low + high) / 2
        below = is_below(middle)
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return (low + high) / 2


def impedance_at(penetration: ArrayLike, solimp: ArrayLike) -> Floats:
    """Return d(r) in (0, 1) at a penetration [m] for solimp (..., 5).

    From d0 at the surface to dwidth at `width`, along two power curves that meet at `midpoint`.
    """
    return _impedance_curve(solimp)(np.abs(penetration))


def rest_penetration(
    load: ArrayLike, inverse_mass: ArrayLike, solref: ArrayLike, solimp: ArrayLike
) -> Floats:
    """Return the penetration [m] of one contact that carries `load` [N] at rest.

    It solves ``r = F A (1 - d(r)) dwidth^2 / (K d(r)^2)`` with A = 1/m1 + 1/m2 [1/kg] of the two
    bodies. Exact for elliptic cones and frictionless contacts; pyramids soften it. Results are
    cached, because many runs need the same.
    """
    arguments = [
        np.asarray(argument, np.float64) for argument in (load, inverse_mass, solref, solimp)
    ]
    return _rest_penetration(
        *((argument.shape, argument.tobytes()) for argument in arguments)
    ).copy()


@lru_cache(maxsize=64)
def _rest_penetration(*arguments: tuple[tuple[int, ...], bytes]) -> Floats:
    load, inverse_mass, solref, solimp = (
        np.frombuffer(values).reshape(shape) for shape, values in arguments
    )
    stiffness, _ = stiffness_damping(solref)
    end = np.clip(solimp[..., 1], *IMPEDANCE_RANGE)
    scale = load * inverse_mass * end**2 / stiffness
    curve = _impedance_curve(solimp)

    def carried(depth: Floats) -> Floats:
        d = curve(depth)
        return scale * (1 - d) / (d * d)

    # d is monotonic in r, so the right side lies between its values at the surface and far below.
    surface, deep = carried(np.zeros_like(scale)), carried(np.full_like(scale, np.inf))
    low, high = np.minimum(surface, deep), np.maximum(surface, deep)
    return _bisect_root(low, high, lambda depth: carried(depth) > depth)


def stiffness_at_rest(
    depth: ArrayLike, load: ArrayLike, inverse_mass: ArrayLike, solimp: ArrayLike
) -> Floats:
    """Return the K [1/s^2] with a given `rest_penetration` [m] above 0 under a load [N].

    If the impedance d is constant, load / depth is ``K / (A (1 - d))`` for every load: a linear
    spring.
    """
    end = np.clip(np.asarray(solimp, dtype=np.float64)[..., 1], *IMPEDANCE_RANGE)
    d, weight = impedance_at(depth, solimp), np.asarray(load) * np.asarray(inverse_mass)
    return weight * (1 - d) * end**2 / (np.asarray(depth) * d**2)


def pyramid_softness(friction: float, condim: int, impratio: float) -> float:
    """Return the factor of a pyramidal cone on the load in the law of rest.

    The 2 (condim - 1) edges of the pyramid share the load:
    ``mu^2 (1 + mu^2) / ((condim - 1) impratio)``, and 1 without friction.
    Source: MuJoCo's mj_makeImpedance.
    """
    square = friction**2
    return square * (1 + square) / ((condim - 1) * impratio) if condim > 1 else 1.0


def _impedance_curve(solimp: ArrayLike) -> Callable[[Floats], Floats]:
    values = np.moveaxis(np.asarray(solimp, dtype=np.float64), -1, 0)
    start, end, middle = (np.clip(values[index], *IMPEDANCE_RANGE) for index in (0, 1, 3))
    width, power = np.maximum(values[2], 0), np.maximum(values[4], 1)
    low, high = middle ** (1 - power), (1 - middle) ** (1 - power)

    def curve(depth: Floats) -> Floats:
        share = np.minimum(depth / np.where(width > 0, width, 1), 1)
        rise = np.where(
            share <= middle, low * share**power, 1 - high * np.maximum(1 - share, 0) ** power
        )
        return start + np.where(width > 0, rise, 0.5) * (end - start)

    return curve


def resolve_impact(
    mass: float, velocity: Floats, normal: Floats, restitution: float, friction: float
) -> Floats:
    """Return the impulse (d,) of an impact on a point mass [N s]; zero if it moves away.

    An impulse J changes the velocity of a mass m by J / m at once. Along the unit normal n, away
    from the surface, Newton's law of restitution demands ``v_n' = -e v_n``, so that ``J_n = m (v_n'
    - v_n) = -(1 + e) m v_n``, which is positive for an approach, v_n < 0.

    Across it, the impulse that would end all sliding is ``-m v_t``. Friction can give at most mu
    J_n (Coulomb's law, integrated over the impact while the slip keeps its direction). If that is
    enough the mass sticks, ``J_t = -m v_t``; otherwise it slides on, and the impulse lies on the
    boundary of the cone, against the slip: ``J_t = -mu J_n v_t / |v_t|``. The two meet at ``|v_t| =
    mu (1 + e) |v_n|``, a cone in velocity space. A point mass has no rotation, so nothing reverses
    within the impact.

    Args:
        mass: the mass of the point [kg].
        velocity: (d,) before the impact [m/s].
        normal: (d,) away from the surface, of any length.
        restitution: in [0, 1].
        friction: at least 0.
    """
    away = normal / np.linalg.norm(normal, axis=-1)
    speed = (velocity * away).sum()
    slip = velocity - speed * away
    pressing = mass * (1 + restitution) * max(-speed, 0)
    ending = mass * np.linalg.norm(slip, axis=-1)
    share = min(ending, friction * pressing) / ending if ending > 0 else 0.0
    return pressing * away - share * mass * slip


def sticking_speed(normal_speed: ArrayLike, restitution: ArrayLike, friction: ArrayLike) -> Floats:
    """Return the largest tangential speed [m/s] that an impact at a normal speed [m/s] stops."""
    approach = np.abs(np.asarray(normal_speed, dtype=np.float64))
    return np.asarray(friction) * (1 + np.asarray(restitution)) * approach
