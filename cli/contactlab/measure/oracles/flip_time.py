"""When a box that spins about its middle axis first turns over."""

import numpy as np

from contactlab.contact import Floats, rotate_back
from contactlab.measure.context import Context
from contactlab.measure.oracles.oracle import Oracle

_DUPLICATIONS = 30


def carlson_rf(x: Floats, y: Floats, z: Floats) -> Floats:
    """Return R_F(x, y, z), Carlson's integral of the first kind, of arguments >= 0.

    It halves the arguments' spread with every duplication theorem (B. C. Carlson, Numerical
    computation of real or complex elliptic integrals, 1995), until they are all but equal.
    """
    for _ in range(_DUPLICATIONS):
        roots = np.sqrt(x), np.sqrt(y), np.sqrt(z)
        shift = roots[0] * roots[1] + roots[1] * roots[2] + roots[2] * roots[0]
        x, y, z = (x + shift) / 4, (y + shift) / 4, (z + shift) / 4
    return 1 / np.sqrt((x + y + z) / 3)


def flip_time(inertia: Floats, spin: Floats) -> Floats:
    """Return (n,) the time [s] at which the spin about the middle axis changes sign.

    Euler's equations keep ``w1^2 + b1 w2^2`` and ``w3^2 + b3 w2^2``, with axis 2 the middle one,
    so that dt = dw2 / (c sqrt(p q)), with p and q those squares: an elliptic integral.

    Args:
        inertia: (n, 3) principal moments [kg m^2], the second between the others.
        spin: (n, 3) angular velocity at the start [rad/s], along the principal axes.
    """
    first, middle, third = inertia.T
    rate = np.abs(third - first) / middle
    share1 = middle * (third - middle) / (first * (third - first))
    share3 = middle * (middle - first) / (third * (third - first))
    speed = np.abs(spin[:, 1])
    total1 = spin[:, 0] ** 2 + share1 * speed**2
    total3 = spin[:, 2] ** 2 + share3 * speed**2

    def from_zero(w: Floats) -> Floats:
        rest1 = np.maximum(1 - share1 * w**2 / total1, 0)
        rest3 = np.maximum(1 - share3 * w**2 / total3, 0)
        return w * carlson_rf(rest1, rest3, np.ones_like(w)) / (rate * np.sqrt(total1 * total3))

    highest = np.sqrt(np.minimum(total1 / share1, total3 / share3))
    rising = (third - first) * spin.prod(axis=1) > 0
    fall = from_zero(speed)
    return np.where(rising, 2 * from_zero(highest) - fall, fall)


def _flip_time(context: Context) -> tuple[Floats, Floats]:
    if context.trace.angular_momentum is None or not context.setup.free_bodies:
        return context.nothing(), context.nothing()
    body = context.setup.free_bodies[0]
    turning = context.trace.qvel[:, 0, body.dof + 3 : body.dof + 6]
    attitude = context.trace.qpos[:, 0, body.qpos + 3 : body.qpos + 7]
    momentum = rotate_back(attitude, context.trace.angular_momentum[:, 0])
    middle = context.trace.qvel[:, :, body.dof + 4]
    return flip_time(momentum / turning, turning), first_zero(context, middle)


def first_zero(context: Context, values: Floats) -> Floats:
    """Return (n,) when [s] values (n, N + 1) first change sign, on a line between two states."""
    crossed = values[:, 1:] * values[:, :-1] < 0
    step = crossed.argmax(axis=1)
    rows = np.arange(len(values))
    before, after = values[rows, step], values[rows, step + 1]
    time = context.trace.timestep * (step + before / (before - after))
    return np.where(crossed.any(axis=1), time, np.nan)


FLIP_TIME = Oracle(
    name="flip_time",
    unit="s",
    relative=True,
    definition=(
        "First time at which a free body, spun about its middle axis, turns over: the elliptic "
        "integral of Euler's equations without torque, from the angular velocity and the angular "
        "momentum at the start. The body's axes are its principal ones, the middle moment about "
        "y, and the start turns about all three. Measured: first change of sign of the first free "
        "body's wy."
    ),
    settings=("timestep",),
    function=_flip_time,
)
