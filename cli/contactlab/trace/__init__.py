"""Arrays of a group of runs, and what is known of the runs beside them; NumPy only."""

from contactlab.trace.arrays import (
    ANGULAR_VELOCITY,
    DISTANCE,
    FORCE,
    FOUND,
    LINEAR_VELOCITY,
    NORMAL,
    POSITION,
    SLOT_WIDTH,
    TANGENT,
    TORQUE,
    Floats,
    Integers,
    PairTrace,
    Trace,
)
from contactlab.trace.checks import Checks
from contactlab.trace.series import NO_CONTACT, SLIDE, STICK, PairSeries
from contactlab.trace.setup import Barrier, FreeBody, Mode, Setup

__all__ = [
    "ANGULAR_VELOCITY",
    "DISTANCE",
    "FORCE",
    "FOUND",
    "LINEAR_VELOCITY",
    "NORMAL",
    "NO_CONTACT",
    "POSITION",
    "SLIDE",
    "SLOT_WIDTH",
    "STICK",
    "TANGENT",
    "TORQUE",
    "Barrier",
    "Checks",
    "Floats",
    "FreeBody",
    "Integers",
    "Mode",
    "PairSeries",
    "PairTrace",
    "Setup",
    "Trace",
]
