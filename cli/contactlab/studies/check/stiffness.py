"""How stiff a contact must be to carry a load at rest within a given depth."""

import math
from collections.abc import Sequence

import numpy as np

from contactlab.contact import Floats, impedance, rest_penetration, stiffness_damping

PRACTICE = (0.005, 1.0)
"""The solref that practice takes where the engine's default sinks too deep."""

_IMPEDANCE_RANGE = (1e-4, 0.9999)
_BELOW = 1 - 1e-6
"""Keeps the depth strictly below, and far above rounding."""

_REFSAFE = 2.0
"""Timesteps to which the engine raises a shorter time constant."""


def stiff_solref(
    load: float, inverse_mass: float, solimp: Floats, timestep: float, depth: float
) -> tuple[float, float]:
    """Return a critically damped solref whose contact rests less deep than `depth` [m].

    Practice's "0.005 1" where that does; else the softest that does, rounded down to two digits.
    At rest ``r = F A (1 - d(r)) dwidth^2 / (K d(r)^2)``, and its right side falls with r, so that
    r is less than `depth` if and only if K is more than the right side times K there. The time
    constant is ``1 / sqrt K``.

    Args:
        load: on one contact [N].
        inverse_mass: 1/m1 + 1/m2 of the two bodies [1/kg].
        solimp: (5,) impedance.
        timestep: length of a step [s]; the engine raises time constants below two of them.
        depth: the depth [m].

    Returns:
        Time constant [s] and damping ratio; the time constant may be below two timesteps, where
        the timestep has to be smaller too.
    """
    if max(PRACTICE[0], _REFSAFE * timestep) == PRACTICE[0]:
        found = rest_penetration(load, inverse_mass, PRACTICE, solimp)
        if float(found) < depth:
            return PRACTICE
    end = float(np.clip(solimp[1], *_IMPEDANCE_RANGE))
    d = float(impedance(depth, solimp))
    stiffness = load * inverse_mass * (1 - d) * end**2 / (d * d) / depth
    return rounded_down(_BELOW / math.sqrt(stiffness)), 1.0


def load_of(depth: float, inverse_mass: float, solref: Sequence[float], solimp: Floats) -> float:
    """Return the load [N] under which a contact rests at a depth [m], by the same law.

    Pyramidal cones rest as under another load, which their friction and dimensions scale.
    """
    end = float(np.clip(solimp[1], *_IMPEDANCE_RANGE))
    d = float(impedance(depth, solimp))
    stiffness, _ = stiffness_damping(solref)
    return depth * float(stiffness) * d * d / (inverse_mass * (1 - d) * end**2)


def longest_timestep(timeconst: float) -> float:
    """Return the longest timestep at which the engine keeps a time constant [s]."""
    return timeconst / _REFSAFE


def rounded_down(value: float) -> float:
    """Return the largest number of two digits that is not above a positive one."""
    digits = math.floor(math.log10(value)) - 1
    # What is a number of two digits but for rounding stays it.
    return float(f"{math.floor(value / 10**digits * (1 + 1e-9))}e{digits}")
