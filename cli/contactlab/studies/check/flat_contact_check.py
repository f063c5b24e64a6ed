"""Check 3: does a body rest on flat ground as practice asks, with the model's own contacts."""

from collections.abc import Iterator, Sequence

import numpy as np

from contactlab.contact import rest_penetration, stiffness_damping
from contactlab.schema import Change, CheckResult, Measure
from contactlab.studies.check.check_results import (
    at_most,
    below,
    change,
    informative,
    mjcf_text,
    not_applicable,
    result,
    violated,
)
from contactlab.studies.check.checked_model import CheckedModel, CheckRun, CheckRunner
from contactlab.studies.check.contact_sets import (
    ContactSet,
    contact_sets,
    kept_solref,
    load_of,
    longest_timestep,
    rounded_down,
    stiff_solref,
)
from contactlab.studies.session import Values

NAME = "flat_contact"
REMEDY = "flat_contact_stiffer"
SCENE = "flat_contact"
DEPTH = 1e-4
"""Steady penetration on flat ground [m] that practice accepts."""

GROWTH = 1e-6
"""Rate of sinking [m/s] at which a body at rest would go 1 % of that depth a second deeper."""

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
"""Time constants after which a contact has settled to rounding."""


def check_flat_contact(runner: CheckRunner) -> CheckResult:
    """Rest a box on flat ground with each distinct set of contact parameters of the model."""
    checked = runner.checked
    sets = contact_sets(checked)
    if not sets:
        reason = "the model has no graded contact pair whose parameters could be tried"
        return not_applicable(NAME, _ASKS, reason)
    runs = _rest(runner, NAME, [_row(checked, each) for each in sets], sets)
    tried = list(zip(sets, runs, strict=True))
    measures = [measure for each in tried for measure in _measures(checked, *each)]
    failed = [each for each in tried if violated(_measures(checked, *each))]
    changes = list(_stiffer(runner, failed)) if failed else []
    return result(
        NAME,
        _ASKS,
        _reason(measures, changes),
        measures,
        changes=changes,
        stores=runner.stores(NAME, REMEDY),
    )


def _row(checked: CheckedModel, contact: ContactSet) -> dict[str, object]:
    row = {name: checked.setting(name) for name in _SETTINGS}
    row |= {
        name: checked.resolved.flags[name] for name in _SWITCHES if name in checked.resolved.flags
    }
    return {**row, **contact.axes, "gravity": gravity(checked), "mass": checked.subject_mass}


def gravity(checked: CheckedModel) -> float:
    """Return the model's gravity [m/s^2]; the Earth's where it has none."""
    return float(np.linalg.norm(checked.setting("gravity"))) or _GRAVITY


def _rest(
    runner: CheckRunner, store: str, rows: Sequence[Values], sets: Sequence[ContactSet]
) -> list[CheckRun]:
    text = "A box at rest on flat ground, with the contact parameters of the model"
    seconds = max(_settling(each) for each in sets)
    return runner.run_scene(store, text, SCENE, rows, seconds)


def _settling(contact: ContactSet) -> float:
    """Return how long a contact takes to come to rest [s], by its slower exponential."""
    stiffness, damping = (float(each) for each in stiffness_damping(contact.record.solref))
    rate = damping / 2 - max(damping**2 / 4 - stiffness, 0) ** 0.5
    return float(np.clip(_TIMES / rate, _SHORTEST, _LONGEST)) if rate > 0 else _LONGEST


def expected_depth(checked: CheckedModel, contact: ContactSet) -> float:
    """Return the closed form's depth [m] of the box at rest, for an elliptic cone."""
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
        below("penetration_steady", depth, "m", DEPTH, name),
        at_most("penetration_growth", growth, "m/s", GROWTH, name),
        informative("penetration_expected", expected_depth(checked, contact), "m", name),
    ]


def _reason(measures: Sequence[Measure], changes: Sequence[Change]) -> str:
    depths = [each for each in measures if each.name == "penetration_steady"]
    worst = max(depths, key=lambda each: each.value if each.value is not None else np.inf)
    if worst.value is None:
        return f"with {worst.of} the box does not rest on the ground"
    said = f"with {worst.of} the box rests {worst.value * 1e3:.3g} mm deep (limit 0.1 mm)"
    growing = [each for each in violated(measures) if each.name == "penetration_growth"]
    if growing:
        said += ", where it does not come to rest" if growing[0].of == worst.of else ""
    cured = [each for each in changes if each.cures]
    return said + (f"; {cured[0].shown}" if cured else "")


def _stiffer(
    runner: CheckRunner, failed: Sequence[tuple[ContactSet, CheckRun]]
) -> Iterator[Change]:
    """Run each failed set with what the closed form asks for, and say what came of it."""
    checked = runner.checked
    sets = [contact for contact, _ in failed]
    settings = [_stiff_settings(checked, *each) for each in failed]
    rows = [{**_row(checked, each), **stiff} for each, stiff in zip(sets, settings, strict=True)]
    for contact, stiff, run in zip(sets, settings, _rest(runner, REMEDY, rows, sets), strict=True):
        depth = run.record.metrics["penetration_steady"]
        cures = not violated(_measures(checked, contact, run))
        rests = "rests nowhere" if depth is None else f"rests {depth * 1e3:.2g} mm deep"
        shown = f"with {_words(stiff)} it {rests}"
        yield change(checked, stiff, cures=cures, shown=shown)


def _words(settings: Values) -> str:
    return " and ".join(f"{name} {mjcf_text(value)}" for name, value in settings.items())


def _stiff_settings(checked: CheckedModel, contact: ContactSet, run: CheckRun) -> dict[str, object]:
    """Return what lets a set rest less deep: a solref, and a timestep that keeps it.

    The closed form is that of elliptic cones; what load it would take for the depth that was
    measured says what a pyramid makes of the load.
    """
    mass, solimp = checked.subject_mass, np.array(contact.axes["solimp"])
    depth = run.record.metrics["penetration_steady"]
    load = mass * gravity(checked) / _CORNERS
    if depth is not None:
        load = max(load, load_of(depth, 1 / mass, contact.solref, solimp))
    solref = stiff_solref(load, 1 / mass, solimp, checked.resolved.timestep, DEPTH)
    settings: dict[str, object] = {"solref": solref}
    if solref != kept_solref(checked, solref):
        settings["timestep"] = rounded_down(longest_timestep(solref[0]))
    return settings
