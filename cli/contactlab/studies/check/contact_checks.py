"""Checks 3 and 6: does a box rest with the model's contacts, and do these push at touch only.

And how stiff a contact must be to carry a load.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from contactlab.contact.contact_laws import (
    IMPEDANCE_RANGE,
    impedance,
    refsafe_solref,
    rest_penetration,
    stiffness_damping,
)
from contactlab.contact.trace_arrays import DISTANCE, FORCE, Floats
from contactlab.judge.limits import MILLIMETRES, MILLISECONDS, Limit, exceeding, informative
from contactlab.schema.check_report import CheckResult, Measure
from contactlab.schema.evidence import PairRecord
from contactlab.schema.setting_values import as_vector
from contactlab.studies.check.check_entries import Measured, check, remedy
from contactlab.studies.check.check_results import mjcf_text
from contactlab.studies.check.check_runs import CheckRun
from contactlab.studies.check.checked_model import (
    NOMINAL_STORE,
    CheckedModel,
    axis_value,
)
from contactlab.studies.session import Values

_LEAST_WIDTH_M = 1e-15


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
    safe = checked.resolved.flags["refsafe"]
    return refsafe_solref(solref, checked.resolved.timestep) if safe else solref


def _clipped(solimp: tuple[float, ...]) -> tuple[float, ...]:
    """Return an impedance within the bounds of the engine."""
    low, high = IMPEDANCE_RANGE
    start, end, middle = (min(max(solimp[place], low), high) for place in (0, 1, 3))
    return start, end, max(solimp[2], _LEAST_WIDTH_M), middle, max(solimp[4], 1.0)


STIFF_SOLREF = (0.005, 1.0)
"""The guideline's solref where the engine's default penetrates too deep; see docs/check.md."""

_BELOW = 1 - 1e-6  # factor that keeps the depth strictly below its limit, beyond rounding


def stiff_solref(
    load: float, inverse_mass: float, solimp: Floats, timestep: float, depth: float
) -> tuple[float, float]:
    """Return a critically damped solref whose contact rests at less than `depth` [m].

    The guideline's "0.005 1" if that suffices; else the softest that does, rounded down to two
    digits. At rest ``r = F A (1 - d(r)) dwidth^2 / (K d(r)^2)``, whose right side falls with r, so
    that r is less than `depth` if and only if K is more than the right side times K there. The time
    constant [s] is ``1 / sqrt K``; if below two timesteps [s], the timestep has to be smaller too.

    The load F [N] is that on one contact, the inverse mass A [1/kg] is 1/m1 + 1/m2 of its bodies.
    """
    found = float(rest_penetration(load, inverse_mass, STIFF_SOLREF, solimp))
    if found < depth and refsafe_solref(STIFF_SOLREF, timestep) == STIFF_SOLREF:
        return STIFF_SOLREF
    stiffness = load / load_at_depth(depth, inverse_mass, 1.0, solimp)
    return rounded_down(_BELOW / math.sqrt(stiffness)), 1.0


def load_at_depth(depth: float, inverse_mass: float, stiffness: float, solimp: Floats) -> float:
    """Return the load [N] under which a contact of a stiffness K [1/s^2] rests at a depth [m].

    The inverse of the law of `stiff_solref`. With pyramidal cones this is an effective load, which
    friction and condim scale.
    """
    end, d = float(np.clip(solimp[1], *IMPEDANCE_RANGE)), float(impedance(depth, solimp))
    return stiffness * (depth * d * d / (inverse_mass * (1 - d) * end**2))


def rounded_down(value: float) -> float:
    """Round a positive number down to two digits."""
    digits = math.floor(math.log10(value)) - 1
    # A number of two digits stays as it is, whatever its rounding error.
    return float(f"{math.floor(value / 10**digits * (1 + 1e-9))}e{digits}")


_FLAT = "flat_contact"  # the check, its store and its scene
_RESTS = "a body rests on flat ground less than 0.1 mm deep, and does not sink further"
_CORNERS = 4
_SETTINGS = (
    *("timestep", "integrator", "cone", "impratio", "jacobian", "solver"),
    *("iterations", "tolerance", "ls_iterations", "ls_tolerance"),
    *("noslip_iterations", "noslip_tolerance"),
)
_SWITCHES = ("refsafe", "diagexact", "eulerdamp", "nativeccd", "multiccd", "warmstart", "island")
_GRAVITY = 9.81
_SHORTEST, _LONGEST = 3.0, 60.0
_TIMES = 30  # time constants in which a mode decays to rounding


@check(
    _FLAT,
    asks=_RESTS,
    place=3,
    limits=(
        Limit("penetration_steady", "m", "warn", 1e-4, strict=True, shown=MILLIMETRES),
        Limit("penetration_growth", "m/s", "warn", 1e-6, shown=(1e6, " µm/s")),
    ),
)
def check_flat_contact(checked: CheckedModel) -> Measured:
    """Rest a box on flat ground with each distinct set of contact parameters of what stands."""
    held = {pair.name for pair in checked.holding.held}
    sets = [contacts for contacts in contact_sets(checked) if held.intersection(contacts.pairs)]
    if not sets:
        return Measured([], [checked.holding.nothing], checked.stores(NOMINAL_STORE))
    text = "A box at rest on flat ground, with the contact parameters of the model"
    seconds = max(_settling(contacts) for contacts in sets)
    rows = [_row(checked, contacts) for contacts in sets]
    pairs = zip(sets, checked.run(_FLAT, text, rows, scene=_FLAT, duration=seconds), strict=True)
    measures = [measure for pair in pairs for measure in _measures(checked, *pair)]
    return Measured(measures, stores=checked.stores(_FLAT))


def _row(checked: CheckedModel, contact: ContactSet) -> Values:
    flags = checked.resolved.flags
    row = {name: checked.resolved.settings[name] for name in _SETTINGS}
    row |= {name: flags[name] for name in _SWITCHES if name in flags}
    return {**row, **contact.axes, "gravity": _gravity(checked), "mass": checked.subject_mass}


def _gravity(checked: CheckedModel) -> float:
    """Return the magnitude of the model's gravity [m/s^2]; the Earth's if it has none."""
    return float(np.linalg.norm(as_vector(checked.resolved.settings["gravity"]))) or _GRAVITY


def _settling(contact: ContactSet) -> float:
    """Return the time [s] in which the slower mode of a contact decays to rounding."""
    stiffness, damping = (float(number) for number in stiffness_damping(contact.record.solref))
    rate = damping / 2 - max(damping**2 / 4 - stiffness, 0) ** 0.5
    return float(np.clip(_TIMES / rate, _SHORTEST, _LONGEST)) if rate > 0 else _LONGEST


def _measures(checked: CheckedModel, contact: ContactSet, run: CheckRun) -> Iterator[Measure]:
    for name in ("penetration_steady", "penetration_growth"):
        value = run.record.metrics[name]
        yield checked.measure(name, math.nan if value is None else value, contact.name)
    # The closed form for elliptic cones.
    load, each = _load(checked), 1 / checked.subject_mass
    expected = rest_penetration(load, each, contact.solref, contact.record.solimp)
    yield informative("penetration_expected", float(expected), "m", contact.name)


def _load(checked: CheckedModel) -> float:
    """Return the load on each corner of the box [N]."""
    return checked.subject_mass * _gravity(checked) / _CORNERS


@remedy("penetration_steady", "penetration_growth")
def stiffer_rest(checked: CheckedModel, result: CheckResult) -> Iterator[Values]:
    """Yield a solref that meets the limit, and a timestep at which refsafe does not raise it.

    The closed form holds for elliptic cones; for pyramidal ones the load is the one that gives the
    measured depth by the same law. The stiffest that a failed set of parameters needs counts.
    """
    failed = {measure.of for measure in exceeding(result.measures)}
    depths = {
        measure.of: measure for measure in result.measures if measure.name == "penetration_steady"
    }
    solref = min(
        _stiff_solref(checked, contacts, depths[contacts.name])
        for contacts in contact_sets(checked)
        if contacts.name in failed
    )
    yield _stiffer(checked, solref)


def _stiff_solref(
    checked: CheckedModel, contact: ContactSet, depth: Measure
) -> tuple[float, float]:
    each, solimp, load = 1 / checked.subject_mass, np.array(contact.axes["solimp"]), _load(checked)
    if depth.value is not None:
        stiffness = float(stiffness_damping(contact.solref)[0])
        load = max(load, load_at_depth(depth.value, each, stiffness, solimp))
    return stiff_solref(load, each, solimp, checked.resolved.timestep, depth.limit or 0.0)


def _stiffer(checked: CheckedModel, solref: tuple[float, ...]) -> Values:
    """Return a solref, and the timestep for it if refsafe would raise it at the model's own."""
    kept = effective_solref(checked, solref) == solref
    return {"solref": solref, **({} if kept else {"timestep": rounded_down(solref[0] / 2)})}


_SHELLS = "shells"
_EARLY = "margin lets contact force start {} before touch"
_PUSHES = "contacts push at touch only, and are no softer than the engine's default"


@check(
    _SHELLS,
    asks=_PUSHES,
    place=6,
    limits=(
        Limit("shell", "m", "warn", 1e-4, shown=MILLIMETRES, exceeded=_EARLY),
        Limit("softness", "s", "warn", 0.02, shown=MILLISECONDS),
    ),
)
def check_contact_margin(checked: CheckedModel) -> Measured:
    """Compare margins, and stiffnesses of solref, with their limits.

    A margin may be as large as the accepted penetration. Grasps that are softer than the engine's
    default, with 0.022 s, sink by more than 3 mm, which the guideline calls exploitation.
    """
    pairs = checked.prepared.pairs
    if not pairs:
        return Measured([], ["the model has no monitored contact pair"])
    distances = _force_distances(checked.nominal)
    notes = [
        f"{name} pushed from {distance * 1e3:.3g} mm, before touch"
        for name, distance in distances.items()
        if distance and pairs[name].margin
    ]
    measures: list[Measure] = []
    for name, record in pairs.items():
        measures.append(checked.measure("shell", record.margin, name))
        if record.margin > 0:
            measures.append(informative("pushes_from", distances.get(name, 0.0), "m", name))
        stiffness = float(stiffness_damping(effective_solref(checked, record.solref))[0])
        soft = stiffness**-0.5 if stiffness > 0 else math.inf
        measures.append(checked.measure("softness", soft, name))
    return Measured(measures, notes, checked.stores(NOMINAL_STORE))


def _force_distances(run: CheckRun) -> dict[str, float]:
    """Return the largest positive distance [m] at which a contact carried force, by pair."""
    if run.record.trace is None:
        return {}
    return {
        pair.name: float(pair.points[pair.points[:, FORCE.start] > 0, DISTANCE].max(initial=0.0))
        for pair in run.trace.pairs
    }


@remedy("shell")
def touch_only(_: CheckedModel, __: CheckResult) -> Iterator[Values]:
    """Yield no margin; `gap` still detects contacts at a distance, without force."""
    yield {"margin": 0.0}


@remedy("softness")
def stiffer(checked: CheckedModel, _: CheckResult) -> Iterator[Values]:
    """Yield the guideline's solref, and a timestep at which refsafe does not raise it."""
    yield _stiffer(checked, STIFF_SOLREF)
