"""Check 3: does a box rest on flat ground, with the contact parameters of the model."""

from collections.abc import Iterator, Sequence

import numpy as np

from contactlab.contact.contact_laws import rest_penetration, stiffness_damping
from contactlab.schema.check_report import Change, CheckResult, Measure
from contactlab.studies.check.check_results import (
    change,
    check_result,
    informative,
    mjcf_text,
    not_applicable,
    strict_limit,
    upper_limit,
    violated,
)
from contactlab.studies.check.checked_model import CheckedModel, CheckRun, CheckRunner
from contactlab.studies.check.contact_sets import (
    ContactSet,
    contact_sets,
    effective_solref,
    load_at_depth,
    longest_timestep,
    rounded_down,
    stiff_solref,
)
from contactlab.studies.session import Values

NAME = "flat_contact"
REMEDY = "flat_contact_stiffer"
SCENE = "flat_contact"
DEPTH = 1e-4
"""Largest accepted steady penetration on flat ground [m]."""

GROWTH = 1e-6
"""Largest accepted growth of penetration [m/s]: 1 % of that depth a second."""

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
    """Rest a box on flat ground with each distinct set of contact parameters of the model."""
    checked = runner.checked
    sets = contact_sets(checked)
    if not sets:
        reason = "the model has no monitored contact pair whose parameters could be tried"
        return not_applicable(NAME, _ASKS, reason)
    runs = _rest(runner, NAME, [_row(checked, each) for each in sets], sets)
    pairs = list(zip(sets, runs, strict=True))
    measures = [measure for each in pairs for measure in _measures(checked, *each)]
    failed = [each for each in pairs if violated(_measures(checked, *each))]
    changes = list(_stiffer(runner, failed)) if failed else []
    return check_result(
        NAME,
        _ASKS,
        _reason(measures, changes),
        measures,
        changes=changes,
        stores=runner.stores(NAME, REMEDY),
    )


def _row(checked: CheckedModel, contact: ContactSet) -> dict[str, object]:
    row = {name: checked.settings[name] for name in _SETTINGS}
    row |= {
        name: checked.resolved.flags[name] for name in _SWITCHES if name in checked.resolved.flags
    }
    return {**row, **contact.axes, "gravity": gravity(checked), "mass": checked.subject_mass}


def gravity(checked: CheckedModel) -> float:
    """Return the magnitude of the model's gravity [m/s^2]; the Earth's if it has none."""
    return float(np.linalg.norm(checked.settings.vector("gravity"))) or _GRAVITY


def _rest(
    runner: CheckRunner, store: str, rows: Sequence[Values], sets: Sequence[ContactSet]
) -> list[CheckRun]:
    text = "A box at rest on flat ground, with the contact parameters of the model"
    seconds = max(_settling(each) for each in sets)
    return runner.run_scene(store, text, SCENE, rows, seconds)


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
        strict_limit("penetration_steady", depth, "m", DEPTH, name),
        upper_limit("penetration_growth", growth, "m/s", GROWTH, name),
        informative("penetration_expected", expected_depth(checked, contact), "m", name),
    ]


def _reason(measures: Sequence[Measure], changes: Sequence[Change]) -> str:
    depths = [each for each in measures if each.name == "penetration_steady"]
    worst = max(depths, key=lambda each: each.value if each.value is not None else np.inf)
    if worst.value is None:
        return f"with {worst.of} the box does not rest on the ground"
    text = f"with {worst.of} the box rests {worst.value * 1e3:.3g} mm deep (limit 0.1 mm)"
    growing = [each for each in violated(measures) if each.name == "penetration_growth"]
    if growing:
        text += ", where it does not come to rest" if growing[0].of == worst.of else ""
    cured = [each for each in changes if each.cures]
    return text + (f"; {cured[0].shown}" if cured else "")


def _stiffer(
    runner: CheckRunner, failed: Sequence[tuple[ContactSet, CheckRun]]
) -> Iterator[Change]:
    """Run each failed set with the solref of the closed form, and yield the changes."""
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
    """Return a solref that meets the limit, and a timestep at which refsafe does not raise it.

    The closed form holds for elliptic cones; for pyramidal ones the load is the one that gives the
    measured depth by the same law.
    """
    mass, solimp = checked.subject_mass, np.array(contact.axes["solimp"])
    depth = run.record.metrics["penetration_steady"]
    load = mass * gravity(checked) / _CORNERS
    if depth is not None:
        load = max(load, load_at_depth(depth, 1 / mass, contact.solref, solimp))
    solref = stiff_solref(load, 1 / mass, solimp, checked.resolved.timestep, DEPTH)
    settings: dict[str, object] = {"solref": solref}
    if solref != effective_solref(checked, solref):
        settings["timestep"] = rounded_down(longest_timestep(solref[0]))
    return settings
