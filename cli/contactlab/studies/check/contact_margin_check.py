"""Check 6: can a policy exploit forces at a distance, or soft contacts."""

import math
from collections.abc import Iterator, Sequence

from contactlab.contact.contact_laws import stiffness_damping
from contactlab.contact.trace_arrays import DISTANCE, FORCE
from contactlab.schema.check_report import Change, CheckResult, Measure
from contactlab.studies.check.check_results import (
    change,
    check_result,
    informative,
    not_applicable,
    upper_limit,
    violated,
)
from contactlab.studies.check.checked_model import CheckedModel, CheckRunner
from contactlab.studies.check.contact_sets import STIFF_SOLREF, effective_solref, longest_timestep

NAME = "shells"
MARGIN = 1e-4
"""Largest accepted margin [m]: as much as the accepted penetration."""

SOFT = 0.02
"""Time constant times damping ratio [s] of the engine's default contact. Grasps with 0.022 s sink
by more than 3 mm, which the guideline calls exploitation of the simulator."""

_ASKS = "contacts push at touch only, and are no softer than the engine's default"
_SLACK = 1 + 1e-9


def check_contact_margin(runner: CheckRunner) -> CheckResult:
    """Compare margins, and stiffnesses of solref, with their limits."""
    pairs = runner.checked.prepared.pairs
    if not pairs:
        return not_applicable(NAME, _ASKS, "the model has no monitored contact pair")
    distances = _force_distances(runner)
    measures = list(_measures(runner, distances))
    return check_result(
        NAME,
        _ASKS,
        _reason(measures),
        measures,
        changes=list(_changes(runner, measures)),
        stores=runner.stores("run"),
    )


def _force_distances(runner: CheckRunner) -> dict[str, float]:
    """Return the largest positive distance [m] at which a contact carried force, by pair."""
    distances: dict[str, float] = {}
    for pair in runner.nominal.trace.pairs if runner.nominal.has_trace else ():
        points = pair.points
        pushing = points[points[:, FORCE.start] > 0, DISTANCE]
        distances[pair.name] = max(float(pushing.max(initial=0.0)), 0.0)
    return distances


def _measures(runner: CheckRunner, distances: dict[str, float]) -> Iterator[Measure]:
    checked = runner.checked
    for name, record in checked.prepared.pairs.items():
        yield upper_limit("shell", record.margin, "m", MARGIN, name)
        if record.margin > 0:
            yield informative("pushes_from", distances.get(name, 0.0), "m", name)
        stiffness, _ = stiffness_damping(effective_solref(checked, record.solref))
        soft = float(stiffness) ** -0.5 if stiffness > 0 else math.inf
        yield upper_limit("softness", soft, "s", SOFT * _SLACK, name)


def _reason(measures: Sequence[Measure]) -> str:
    shells = [each for each in violated(measures) if each.name == "shell"]
    soft = [each for each in violated(measures) if each.name == "softness"]
    pushes = {each.of: each.value or 0.0 for each in measures if each.name == "pushes_from"}
    parts: list[str] = []
    if shells:
        worst = max(shells, key=lambda each: each.value or 0.0)
        size, from_ = (worst.value or 0.0) * 1e3, pushes.get(worst.of, 0.0) * 1e3
        parts.append(
            f"{worst.of} has a margin of {size:.3g} mm, in which contact pushes before touch; "
            f"in this run it did so from {from_:.3g} mm"
            if from_
            else f"{worst.of} has a margin of {size:.3g} mm, in which contact can push before touch"
        )
        parts += [f"so have {len(shells) - 1} other pairs"] if len(shells) > 1 else []
    if soft:
        worst = max(soft, key=lambda each: math.inf if each.value is None else each.value)
        softness = "no stiffness" if worst.value is None else f"a softness of {worst.value:.3g} s"
        parts.append(f"{worst.of} has {softness}, above the default's {SOFT:g} s")
    return "; ".join(parts) or "no pair pushes before touch, and none is softer than the default"


def _changes(runner: CheckRunner, measures: Sequence[Measure]) -> Iterator[Change]:
    names = {each.name for each in violated(measures)}
    if "shell" in names:
        shown = "contact begins at touch; `gap` still detects it at a distance, without force"
        yield change(runner.checked, {"margin": 0.0}, cures=None, shown=shown)
    if "softness" in names:
        shown = f"the guideline's stiffer contact, instead of {SOFT:g} s and more"
        yield change(runner.checked, _stiffer(runner.checked), cures=None, shown=shown)


def _stiffer(checked: CheckedModel) -> dict[str, object]:
    """Return the guideline's solref, and a timestep at which refsafe does not raise it."""
    settings: dict[str, object] = {"solref": STIFF_SOLREF}
    if effective_solref(checked, STIFF_SOLREF) != STIFF_SOLREF:
        settings["timestep"] = longest_timestep(STIFF_SOLREF[0])
    return settings
