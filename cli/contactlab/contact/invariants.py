"""What a passive run conserves, at some of its states."""

from typing import NamedTuple

from contactlab.contact.arrays import Floats


class Invariants(NamedTuple):
    """Energy and momenta at T states.

    Attributes:
        energy: (T,) mechanical energy [J].
        kinetic: (T,) the kinetic part of it [J].
        momentum: (T, 3) linear momentum [kg m/s], or None where the system is not free.
        spin: (T, 3) angular momentum about the centre of mass [kg m^2/s], or None likewise.
        mass: total mass [kg].
        lift: energy that lifts everything by 1 mm [J].
    """

    energy: Floats
    kinetic: Floats
    momentum: Floats | None
    spin: Floats | None
    mass: float
    lift: float
