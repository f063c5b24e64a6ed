"""Check 6: does the model offer forces at a distance, or softness, that a policy can exploit."""

import math
from collections.abc import Iterator, Sequence

from contactlab.contact import DISTANCE, FORCE, stiffness_damping
from contactlab.schema import Change, CheckResult, Measure
from contactlab.studies.check.check_results import (
    at_most,
    change,
    informative,
    not_applicable,
    result,
    violated,
)
from contactlab.studies.check.checked_model import CheckedModel, CheckRunner
from contactlab.studies.check.contact_sets import PRACTICE, kept_solref, longest_timestep

NAME = "shells"
MARGIN = 1e-4
"""Distance [m] at which contact may push: as much as practice lets a body sink."""

SOFT = 0.02
"""Time constant times damping ratio [s] of the engine's default contact. Grasps with 0.022 s sink
by more than the 3 mm that practice calls exploited."""

_ASKS = "contacts push at touch only, and are no softer than the engine's default"
_SLACK = 1 + 1e-9


def check_contact_margin(runner: CheckRunner) -> CheckResult:
    """Look for margins within which contact acts before touch, and for soft references."""
    pairs = runner.checked.prepared.pairs
    if not pairs:
        return not_applicable(NAME, _ASKS, "the model has no graded contact pair")
    reached = _reached(runner)
    measures = list(_measures(runner, reached))
    return result(
        NAME,
        _ASKS,
        _reason(measures),
        measures,
        changes=list(_changes(runner, measures)),
        stores=runner.stores("run"),
    )


def _reached(runner: CheckRunner) -> dict[str, float]:
    """Return by pair the largest positive distance [m] at which a contact carried force."""
    reached: dict[str, float] = {}
    for pair in runner.nominal.trace.pairs if runner.nominal.kept else ():
        points = pair.points
        pushing = points[points[:, FORCE.start] > 0, DISTANCE]
        reached[pair.name] = max(float(pushing.max(initial=0.0)), 0.0)
    return reached


def _measures(runner: CheckRunner, reached: dict[str, float]) -> Iterator[Measure]:
    checked = runner.checked
    for name, record in checked.prepared.pairs.items():
        yield at_most("shell", record.margin, "m", MARGIN, name)
        if record.margin > 0:
            yield informative("pushes_from", reached.get(name, 0.0), "m", name)
        stiffness, _ = stiffness_damping(kept_solref(checked, record.solref))
        soft = float(stiffness) ** -0.5 if stiffness > 0 else math.inf
        yield at_most("softness", soft, "s", SOFT * _SLACK, name)


def _reason(measures: Sequence[Measure]) -> str:
    shells = [each for each in violated(measures) if each.name == "shell"]
    soft = [each for each in violated(measures) if each.name == "softness"]
    pushes = {each.of: each.value or 0.0 for each in measures if each.name == "pushes_from"}
    parts: list[str] = []
    if shells:
        worst = max(shells, key=lambda each: each.value or 0.0)
        size, from_ = (worst.value or 0.0) * 1e3, pushes.get(worst.of, 0.0) * 1e3
        parts.append(
            f"{worst.of} has a shell of {size:.3g} mm in which contact pushes before touch, "
            f"and did in this run from {from_:.3g} mm"
            if from_
            else f"{worst.of} has a shell of {size:.3g} mm in which contact can push before touch"
        )
        parts += [f"so have {len(shells) - 1} other pairs"] if len(shells) > 1 else []
    if soft:
        worst = max(soft, key=lambda each: math.inf if each.value is None else each.value)
        said = "no stiffness" if worst.value is None else f"a softness of {worst.value:.3g} s"
        parts.append(f"{worst.of} has {said}, above the default's {SOFT:g} s")
    return "; ".join(parts) or "no pair pushes before touch, and none is softer than the default"


def _changes(runner: CheckRunner, measures: Sequence[Measure]) -> Iterator[Change]:
    names = {each.name for each in violated(measures)}
    if "shell" in names:
        shown = "contact begins at touch; `gap` keeps a distance at which it is found, forceless"
        yield change(runner.checked, {"margin": 0.0}, cures=None, shown=shown)
    if "softness" in names:
        shown = f"practice's stiffer contact, instead of {SOFT:g} s and more"
        yield change(runner.checked, _stiffer(runner.checked), cures=None, shown=shown)


def _stiffer(checked: CheckedModel) -> dict[str, object]:
    """Return practice's solref, and a timestep at which the engine keeps it."""
    settings: dict[str, object] = {"solref": PRACTICE}
    if kept_solref(checked, PRACTICE) != PRACTICE:
        settings["timestep"] = longest_timestep(PRACTICE[0])
    return settings
