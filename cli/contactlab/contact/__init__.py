"""The contact model in closed form, and the arrays that one rollout leaves."""

from contactlab.contact.arrays import (
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
from contactlab.contact.checks import Checks
from contactlab.contact.contact_law import (
    damping_ratio,
    damping_ratio_of,
    impedance,
    rest_penetration,
    restitution_of,
    stiffness_damping,
    timeconst_dampratio,
)
from contactlab.contact.impact import Impact, resolve_impact, sticking_speed
from contactlab.contact.invariants import Invariants
from contactlab.contact.joints import Joints
from contactlab.contact.motion import MODE_COLOURS, ContactForces, Form, Motion, Shape
from contactlab.contact.series import NO_CONTACT, SLIDE, STICK, PairSeries
from contactlab.contact.setup import Barrier, FreeBody, Hold, Mode, Setup

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
    "Impact",
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
    "damping_ratio",
    "damping_ratio_of",
    "impedance",
    "resolve_impact",
    "rest_penetration",
    "restitution_of",
    "sticking_speed",
    "stiffness_damping",
    "timeconst_dampratio",
]
