"""Checks 3 and 6: does a box rest with the model's contacts, and do these push at touch only."""

import math
from collections.abc import Iterator

import numpy as np

from contactlab.contact.contact_laws import rest_penetration, stiffness_damping
from contactlab.contact.trace_arrays import DISTANCE, FORCE
from contactlab.scene.setting_values import as_vector
from contactlab.schema.check_report import CheckResult, Measure
from contactlab.studies.check.check_results import check_result, informative, violated
from contactlab.studies.check.check_runs import CheckRun
from contactlab.studies.check.checked_model import HOLD_STORE, NOMINAL_STORE, CheckedModel
from contactlab.studies.check.contact_sets import (
    STIFF_SOLREF,
    ContactSet,
    contact_sets,
    effective_solref,
    load_at_depth,
    longest_timestep,
    rounded_down,
    stiff_solref,
)
from contactlab.studies.check.hold_check import nothing_held
from contactlab.studies.session import Values

_FLAT = "flat_contact"
"""The check, its store and its scene."""

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
_TIMES = 30
"""Time constants in which a mode decays to rounding."""


def check_flat_contact(checked: CheckedModel) -> CheckResult:
    """Rest a box on flat ground with each distinct set of contact parameters of what stands."""
    held = {each.name for each in checked.holding.held}
    sets = [each for each in contact_sets(checked) if held.intersection(each.pairs)]
    if not sets:
        stores = checked.stores(NOMINAL_STORE, HOLD_STORE)
        return check_result(_FLAT, _RESTS, [], [nothing_held(checked.holding)], stores)
    text = "A box at rest on flat ground, with the contact parameters of the model"
    seconds = max(_settling(each) for each in sets)
    rows = [_row(checked, each) for each in sets]
    runs = checked.run(_FLAT, text, rows, scene=_FLAT, duration=seconds)
    pairs = zip(sets, runs, strict=True)
    measures = [measure for each in pairs for measure in _measures(checked, *each)]
    return check_result(_FLAT, _RESTS, measures, stores=checked.stores(_FLAT))


def _row(checked: CheckedModel, contact: ContactSet) -> Values:
    flags = checked.resolved.flags
    row = {name: checked.settings[name] for name in _SETTINGS}
    row |= {name: flags[name] for name in _SWITCHES if name in flags}
    return {**row, **contact.axes, "gravity": _gravity(checked), "mass": checked.subject_mass}


def _gravity(checked: CheckedModel) -> float:
    """Return the magnitude of the model's gravity [m/s^2]; the Earth's if it has none."""
    return float(np.linalg.norm(as_vector(checked.settings["gravity"]))) or _GRAVITY


def _settling(contact: ContactSet) -> float:
    """Return the time [s] in which the slower mode of a contact decays to rounding."""
    stiffness, damping = (float(each) for each in stiffness_damping(contact.record.solref))
    rate = damping / 2 - max(damping**2 / 4 - stiffness, 0) ** 0.5
    return float(np.clip(_TIMES / rate, _SHORTEST, _LONGEST)) if rate > 0 else _LONGEST


def _measures(checked: CheckedModel, contact: ContactSet, run: CheckRun) -> Iterator[Measure]:
    for name in ("penetration_steady", "penetration_growth"):
        value = run.record.metrics[name]
        found = math.nan if value is None else value
        yield checked.limits.measure(name, found, contact.name)
    # The closed form for elliptic cones.
    load, each = _load(checked), 1 / checked.subject_mass
    expected = rest_penetration(load, each, contact.solref, contact.record.solimp)
    yield informative("penetration_expected", float(expected), "m", contact.name)


def _load(checked: CheckedModel) -> float:
    """Return the load on each corner of the box [N]."""
    return checked.subject_mass * _gravity(checked) / _CORNERS


def stiffer_rest(checked: CheckedModel, result: CheckResult) -> Iterator[Values]:
    """Yield a solref that meets the limit, and a timestep at which refsafe does not raise it.

    The closed form holds for elliptic cones; for pyramidal ones the load is the one that gives the
    measured depth by the same law. The stiffest that a failed set of parameters needs counts.
    """
    failed = {each.of for each in violated(result.measures)}
    depths = {each.of: each for each in result.measures if each.name == "penetration_steady"}
    solrefs = [
        _stiff_solref(checked, contact, depths[contact.name])
        for contact in contact_sets(checked)
        if contact.name in failed
    ]
    solref = min(solrefs)
    yield _stiffer(checked, solref, rounded_down(longest_timestep(solref[0])))


def _stiff_solref(
    checked: CheckedModel, contact: ContactSet, depth: Measure
) -> tuple[float, float]:
    each, solimp, load = 1 / checked.subject_mass, np.array(contact.axes["solimp"]), _load(checked)
    if depth.value is not None:
        load = max(load, load_at_depth(depth.value, each, contact.solref, solimp))
    return stiff_solref(load, each, solimp, checked.resolved.timestep, depth.limit or 0.0)


def _stiffer(checked: CheckedModel, solref: tuple[float, ...], timestep: float) -> Values:
    """Return a solref, and the timestep for it if refsafe would raise it at the model's own."""
    kept = effective_solref(checked, solref) == solref
    return {"solref": solref} if kept else {"solref": solref, "timestep": timestep}


_SHELLS = "shells"
_PUSHES = "contacts push at touch only, and are no softer than the engine's default"


def check_contact_margin(checked: CheckedModel) -> CheckResult:
    """Compare margins, and stiffnesses of solref, with their limits.

    A margin may be as large as the accepted penetration. Grasps that are softer than the engine's
    default, with 0.022 s, sink by more than 3 mm, which the guideline calls exploitation.
    """
    pairs = checked.prepared.pairs
    if not pairs:
        return check_result(_SHELLS, _PUSHES, [], ["the model has no monitored contact pair"])
    distances = _force_distances(checked.nominal)
    notes = [
        f"{name} pushed from {distance * 1e3:.3g} mm, before touch"
        for name, distance in distances.items()
        if distance and pairs[name].margin
    ]
    measures: list[Measure] = []
    for name, record in pairs.items():
        measures.append(checked.limits.measure("shell", record.margin, name))
        if record.margin > 0:
            measures.append(informative("pushes_from", distances.get(name, 0.0), "m", name))
        stiffness = float(stiffness_damping(effective_solref(checked, record.solref))[0])
        soft = stiffness**-0.5 if stiffness > 0 else math.inf
        measures.append(checked.limits.measure("softness", soft, name))
    return check_result(_SHELLS, _PUSHES, measures, notes, checked.stores(NOMINAL_STORE))


def _force_distances(run: CheckRun) -> dict[str, float]:
    """Return the largest positive distance [m] at which a contact carried force, by pair."""
    if run.record.trace is None:
        return {}
    return {
        pair.name: float(pair.points[pair.points[:, FORCE.start] > 0, DISTANCE].max(initial=0.0))
        for pair in run.trace.pairs
    }


def touch_only(_: CheckedModel, __: CheckResult) -> Iterator[Values]:
    """Yield no margin; `gap` still detects contacts at a distance, without force."""
    yield {"margin": 0.0}


def stiffer(checked: CheckedModel, _: CheckResult) -> Iterator[Values]:
    """Yield the guideline's solref, and a timestep at which refsafe does not raise it."""
    yield _stiffer(checked, STIFF_SOLREF, longest_timestep(STIFF_SOLREF[0]))
