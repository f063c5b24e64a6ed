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
    Held,
    Integers,
    PairTrace,
    Trace,
)
from contactlab.trace.checks import Checks
from contactlab.trace.invariants import Invariants
from contactlab.trace.joints import Joints
from contactlab.trace.motion import MODE_COLOURS, ContactForces, Form, Motion, Shape
from contactlab.trace.series import NO_CONTACT, SLIDE, STICK, PairSeries
from contactlab.trace.setup import Barrier, FreeBody, Hold, Mode, Setup

__all__ = [
    "ANGULAR_VELOCITY",
    "DISTANCE",
    "FORCE",
    "FOUND",
    "LINEAR_VELOCITY",
    "MODE_COLOURS",
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
    "ContactForces",
    "Floats",
    "Form",
    "FreeBody",
    "Held",
    "Hold",
    "Integers",
    "Invariants",
    "Joints",
    "Mode",
    "Motion",
    "PairSeries",
    "PairTrace",
    "Setup",
    "Shape",
    "Trace",
]
