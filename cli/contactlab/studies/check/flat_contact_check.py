"""Check 3: does a box rest on flat ground, with the contact parameters of what stands."""

from collections.abc import Iterator

import numpy as np

from contactlab.contact.contact_laws import rest_penetration, stiffness_damping
from contactlab.schema.check_report import CheckResult, Measure
from contactlab.studies.check.check_results import (
    check_result,
    informative,
    not_applicable,
    violated,
)
from contactlab.studies.check.check_runner import HOLD_STORE, NOMINAL_STORE, CheckRunner
from contactlab.studies.check.checked_model import CheckedModel, CheckRun
from contactlab.studies.check.contact_sets import (
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

NAME = "flat_contact"
SCENE = "flat_contact"

_ASKS = "a body rests on flat ground less than 0.1 mm deep, and does not sink further"
_CORNERS = 4
_SETTINGS = (
    "timestep",
    "integrator",
    "cone",
    "impratio",
    "jacobian",
    "solver",
    "iterations",
    "tolerance",
    "ls_iterations",
    "ls_tolerance",
    "noslip_iterations",
    "noslip_tolerance",
)
_SWITCHES = ("refsafe", "diagexact", "eulerdamp", "nativeccd", "multiccd", "warmstart", "island")
_GRAVITY = 9.81
_SHORTEST, _LONGEST = 3.0, 60.0
_TIMES = 30
"""Time constants in which a mode decays to rounding."""


def check_flat_contact(runner: CheckRunner) -> CheckResult:
    """Rest a box on flat ground with each distinct set of contact parameters of what stands."""
    checked = runner.checked
    held = {each.name for each in runner.holding.held}
    sets = [each for each in contact_sets(checked) if held.intersection(each.pairs)]
    if not sets:
        reason = nothing_held(runner.holding)
        return not_applicable(NAME, _ASKS, reason, stores=runner.stores(NOMINAL_STORE, HOLD_STORE))
    text = "A box at rest on flat ground, with the contact parameters of the model"
    seconds = max(_settling(each) for each in sets)
    runs = runner.run_scene(NAME, text, SCENE, [_row(checked, each) for each in sets], seconds)
    pairs = zip(sets, runs, strict=True)
    measures = [measure for each in pairs for measure in _measures(checked, *each)]
    return check_result(NAME, _ASKS, measures, stores=runner.stores(NAME))


def _row(checked: CheckedModel, contact: ContactSet) -> dict[str, object]:
    row = {name: checked.settings[name] for name in _SETTINGS}
    row |= {
        name: checked.resolved.flags[name] for name in _SWITCHES if name in checked.resolved.flags
    }
    return {**row, **contact.axes, "gravity": gravity(checked), "mass": checked.subject_mass}


def gravity(checked: CheckedModel) -> float:
    """Return the magnitude of the model's gravity [m/s^2]; the Earth's if it has none."""
    return float(np.linalg.norm(checked.settings.vector("gravity"))) or _GRAVITY


def _settling(contact: ContactSet) -> float:
    """Return the time [s] in which the slower mode of a contact decays to rounding."""
    stiffness, damping = (float(each) for each in stiffness_damping(contact.record.solref))
    rate = damping / 2 - max(damping**2 / 4 - stiffness, 0) ** 0.5
    return float(np.clip(_TIMES / rate, _SHORTEST, _LONGEST)) if rate > 0 else _LONGEST


def expected_depth(checked: CheckedModel, contact: ContactSet) -> float:
    """Return the depth [m] of the box at rest by the closed form for elliptic cones."""
    mass = checked.subject_mass
    load = mass * gravity(checked) / _CORNERS
    return float(rest_penetration(load, 1 / mass, contact.solref, contact.record.solimp))


def _measures(checked: CheckedModel, contact: ContactSet, run: CheckRun) -> list[Measure]:
    metrics, name = run.record.metrics, contact.name
    depth, growth = (
        np.nan if value is None else value
        for value in (metrics["penetration_steady"], metrics["penetration_growth"])
    )
    return [
        checked.limits.measure("penetration_steady", depth, name),
        checked.limits.measure("penetration_growth", growth, name),
        informative("penetration_expected", expected_depth(checked, contact), "m", name),
    ]


def stiffer_rest(runner: CheckRunner, result: CheckResult) -> Iterator[Values]:
    """Yield a solref that meets the limit, and a timestep at which refsafe does not raise it.

    The closed form holds for elliptic cones; for pyramidal ones the load is the one that gives the
    measured depth by the same law. The stiffest that a failed set of parameters needs counts.
    """
    checked = runner.checked
    failed = {each.of for each in violated(result.measures)}
    depths = {each.of: each for each in result.measures if each.name == "penetration_steady"}
    solrefs = [
        _stiff_solref(checked, contact, depths[contact.name])
        for contact in contact_sets(checked)
        if contact.name in failed
    ]
    solref = min(solrefs)
    settings: dict[str, object] = {"solref": solref}
    if solref != effective_solref(checked, solref):
        settings["timestep"] = rounded_down(longest_timestep(solref[0]))
    yield settings


def _stiff_solref(
    checked: CheckedModel, contact: ContactSet, depth: Measure
) -> tuple[float, float]:
    mass, solimp = checked.subject_mass, np.array(contact.axes["solimp"])
    load = mass * gravity(checked) / _CORNERS
    if depth.value is not None:
        load = max(load, load_at_depth(depth.value, 1 / mass, contact.solref, solimp))
    limit = depth.limit or 0.0
    return stiff_solref(load, 1 / mass, solimp, checked.resolved.timestep, limit)
