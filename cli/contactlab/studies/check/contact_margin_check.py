"""Check 6: can a policy exploit forces at a distance, or soft contacts."""

import math
from collections.abc import Iterator

from contactlab.contact.contact_laws import stiffness_damping
from contactlab.contact.trace_arrays import DISTANCE, FORCE
from contactlab.schema.check_report import CheckResult, Measure
from contactlab.studies.check.check_results import check_result, informative, not_applicable
from contactlab.studies.check.check_runner import NOMINAL_STORE, CheckRunner
from contactlab.studies.check.checked_model import CheckedModel
from contactlab.studies.check.contact_sets import STIFF_SOLREF, effective_solref, longest_timestep
from contactlab.studies.session import Values

NAME = "shells"
_ASKS = "contacts push at touch only, and are no softer than the engine's default"


def check_contact_margin(runner: CheckRunner) -> CheckResult:
    """Compare margins, and stiffnesses of solref, with their limits.

    A margin may be as large as the accepted penetration. Grasps that are softer than the engine's
    default, with 0.022 s, sink by more than 3 mm, which the guideline calls exploitation.
    """
    pairs = runner.checked.prepared.pairs
    if not pairs:
        return not_applicable(NAME, _ASKS, "the model has no monitored contact pair")
    distances = _force_distances(runner)
    notes = [
        f"{name} pushed from {distance * 1e3:.3g} mm, before touch"
        for name, distance in distances.items()
        if distance and pairs[name].margin
    ]
    measures = list(_measures(runner.checked, distances))
    return check_result(NAME, _ASKS, measures, notes=notes, stores=runner.stores(NOMINAL_STORE))


def _force_distances(runner: CheckRunner) -> dict[str, float]:
    """Return the largest positive distance [m] at which a contact carried force, by pair."""
    distances: dict[str, float] = {}
    for pair in runner.nominal.trace.pairs if runner.nominal.has_trace else ():
        points = pair.points
        pushing = points[points[:, FORCE.start] > 0, DISTANCE]
        distances[pair.name] = max(float(pushing.max(initial=0.0)), 0.0)
    return distances


def _measures(checked: CheckedModel, distances: dict[str, float]) -> Iterator[Measure]:
    for name, record in checked.prepared.pairs.items():
        yield checked.limits.measure("shell", record.margin, name)
        if record.margin > 0:
            yield informative("pushes_from", distances.get(name, 0.0), "m", name)
        stiffness, _ = stiffness_damping(effective_solref(checked, record.solref))
        soft = float(stiffness) ** -0.5 if stiffness > 0 else math.inf
        yield checked.limits.measure("softness", soft, name)


def touch_only(_: CheckRunner, __: CheckResult) -> Iterator[Values]:
    """Yield no margin; `gap` still detects contacts at a distance, without force."""
    yield {"margin": 0.0}


def stiffer(runner: CheckRunner, _: CheckResult) -> Iterator[Values]:
    """Yield the guideline's solref, and a timestep at which refsafe does not raise it."""
    settings: dict[str, object] = {"solref": STIFF_SOLREF}
    if effective_solref(runner.checked, STIFF_SOLREF) != STIFF_SOLREF:
        settings["timestep"] = longest_timestep(STIFF_SOLREF[0])
    yield settings
