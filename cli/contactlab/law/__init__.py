"""Closed forms of contact: the engine's soft contact, and impact by impulse."""

from contactlab.law.contact import (
    damping_ratio,
    damping_ratio_of,
    impedance,
    rest_penetration,
    restitution_of,
    stiffness_damping,
    timeconst_dampratio,
)
from contactlab.law.impact import Impact, resolve_impact, sticking_speed

__all__ = [
    "Impact",
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
