"""Distinct contact parameters of a model, and how stiff a contact must be to carry a load."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from contactlab.contact.contact_laws import impedance, rest_penetration, stiffness_damping
from contactlab.contact.trace_arrays import Floats
from contactlab.schema.evidence import PairRecord
from contactlab.studies.check.check_results import mjcf_text
from contactlab.studies.check.checked_model import CheckedModel, axis_value

_REFSAFE_STEPS = 2.0
"""Timesteps to which refsafe raises a shorter time constant."""

_IMPEDANCE_RANGE = (1e-4, 0.9999)
"""Bounds that the engine holds an impedance to."""

_LEAST_WIDTH = 1e-15


@dataclass(frozen=True)
class ContactSet:
    """Monitored pairs with equal contact parameters."""

    record: PairRecord  # the parameters
    # As the engine uses it: refsafe raises time constants to two timesteps.
    solref: tuple[float, ...]
    pairs: tuple[str, ...]  # names of the pairs

    @property
    def name(self) -> str:
        """Its parameters, as text."""
        record = self.record
        text = f"solref {mjcf_text(record.solref)}, solimp {mjcf_text(record.solimp)}"
        if record.margin:
            text += f", margin {record.margin:g}"
        return f"{text}, condim {record.condim}, friction {record.friction[0]:g}"

    @property
    def axes(self) -> Mapping[str, object]:
        """The parameters, by axis."""
        names = ("solref", "friction", "condim", "margin", "gap")
        values = {name: axis_value(name, getattr(self.record, name)) for name in names}
        return {**values, "solimp": _clipped(self.record.solimp)}


def contact_sets(checked: CheckedModel) -> list[ContactSet]:
    """Return the distinct contact parameters, in the order of the pairs."""
    pairs: dict[PairRecord, list[str]] = {}
    for name, record in checked.prepared.pairs.items():
        pairs.setdefault(record, []).append(name)
    return [
        ContactSet(record, effective_solref(checked, record.solref), tuple(names))
        for record, names in pairs.items()
    ]


def effective_solref(checked: CheckedModel, solref: tuple[float, ...]) -> tuple[float, ...]:
    """Return a solref as the engine uses it: refsafe raises time constants to two timesteps."""
    if solref[0] <= 0 or not checked.resolved.flags["refsafe"]:
        return solref
    return max(solref[0], _REFSAFE_STEPS * checked.resolved.timestep), solref[1]


def _clipped(solimp: tuple[float, ...]) -> tuple[float, ...]:
    """Return an impedance within the bounds of the engine."""
    low, high = _IMPEDANCE_RANGE
    start, end, middle = (min(max(solimp[place], low), high) for place in (0, 1, 3))
    return start, end, max(solimp[2], _LEAST_WIDTH), middle, max(solimp[4], 1.0)


STIFF_SOLREF = (0.005, 1.0)
"""The guideline's solref where the engine's default penetrates too deep; see docs/check.md."""

_BELOW = 1 - 1e-6
"""Factor that keeps the depth strictly below its limit, beyond rounding."""


def stiff_solref(
    load: float, inverse_mass: float, solimp: Floats, timestep: float, depth: float
) -> tuple[float, float]:
    """Return a critically damped solref whose contact rests at less than `depth` [m].

    The guideline's "0.005 1" if that suffices; else the softest that does, rounded down to two
    digits. At rest ``r = F A (1 - d(r)) dwidth^2 / (K d(r)^2)``, whose right side falls with r, so
    that r is less than `depth` if and only if K is more than the right side times K there. The time
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
    if max(STIFF_SOLREF[0], _REFSAFE_STEPS * timestep) == STIFF_SOLREF[0]:
        found = rest_penetration(load, inverse_mass, STIFF_SOLREF, solimp)
        if float(found) < depth:
            return STIFF_SOLREF
    end = float(np.clip(solimp[1], *_IMPEDANCE_RANGE))
    d = float(impedance(depth, solimp))
    stiffness = load * inverse_mass * (1 - d) * end**2 / (d * d) / depth
    return rounded_down(_BELOW / math.sqrt(stiffness)), 1.0


def load_at_depth(
    depth: float, inverse_mass: float, solref: Sequence[float], solimp: Floats
) -> float:
    """Return the load [N] under which a contact rests at a depth [m].

    The inverse of the law of `stiff_solref`. With pyramidal cones this is an effective load, which
    friction and condim scale.
    """
    end = float(np.clip(solimp[1], *_IMPEDANCE_RANGE))
    d = float(impedance(depth, solimp))
    stiffness, _ = stiffness_damping(solref)
    return depth * float(stiffness) * d * d / (inverse_mass * (1 - d) * end**2)


def longest_timestep(timeconst: float) -> float:
    """Return the longest timestep at which refsafe leaves a time constant [s] as it is."""
    return timeconst / _REFSAFE_STEPS


def rounded_down(value: float) -> float:
    """Round a positive number down to two digits."""
    digits = math.floor(math.log10(value)) - 1
    # A number of two digits stays as it is, whatever its rounding error.
    return float(f"{math.floor(value / 10**digits * (1 + 1e-9))}e{digits}")
