"""Check 4: do the pairs that are held or stand stay in their places."""

from collections.abc import Iterator

import numpy as np

from contactlab.schema.check_report import CheckResult, Measure
from contactlab.studies.check.check_results import Limits, check_result, informative
from contactlab.studies.check.check_runs import CheckRun, HeldPair, Holding
from contactlab.studies.check.checked_model import HOLD_STORE, NOMINAL_STORE, CheckedModel
from contactlab.studies.session import Values

NAME = "hold"
FIRM: Values = {"cone": "elliptic", "impratio": 10.0}
FIRMEST: Values = {**FIRM, "solref": (0.005, 1.0)}
HARD: Values = {"solimp": (0.99, 0.999, 0.001, 0.5, 2.0)}
"""The guideline's changes: against slip, against slip and depth, against chatter."""

_SHARES = (0.5, 0.25)
_BANDS = ((5e-3, "broken"), (3e-3, "exploited"), (1e-3, "a compromise"))
_ASKS = "what is held or stands stays: below 5 mode switches a second, 1 mm deep, 0.1 mm of slip"


def check_hold(checked: CheckedModel) -> CheckResult:
    """Measure the pairs that are held or stand in the window of a hold."""
    limits, runs = checked.limits, (checked.nominal, checked.standing)
    incomplete = next((run for run in runs if not run.is_complete), None)
    stores = checked.stores(NOMINAL_STORE, HOLD_STORE)
    if incomplete:
        lost = incomplete.record.steps_asked - incomplete.record.steps
        notes = [f"the run is not complete: {incomplete.record.status_reason}"]
        measures = [limits.measure("steps_lost", max(lost, 1))]
        return check_result(NAME, _ASKS, measures, notes, stores)
    holding = checked.holding
    measures = [each for pair in holding.held for each in _measures(pair, holding, limits)]
    if holding.declared:
        measures += _declared(checked.standing, limits)
    if not measures:
        return check_result(NAME, _ASKS, [], [nothing_held(holding)], stores)
    notes = [f"measured from {holding.window[0]:g} to {holding.window[1]:g} s", *_bands(holding)]
    return check_result(NAME, _ASKS, measures, notes, stores)


def _measures(held: HeldPair, holding: Holding, limits: Limits) -> list[Measure]:
    severity = "error" if holding.declared else None
    return [
        limits.measure("mode_switches", held.switches, held.name),
        limits.measure("penetration_mean", held.depth, held.name),
        limits.measure("slip", held.slip, held.name, severity=severity),
        informative("force_mean", held.force, "N", held.name),
    ]


def _declared(run: CheckRun, limits: Limits) -> list[Measure]:
    """Return the measures of a hold that the scene declares."""
    contact, drop = (run.record.metrics.get(name) for name in ("hold_contact", "hold_drop"))
    share = np.nan if contact is None else contact
    more = [] if drop is None else [informative("drop", drop, "m")]
    return [limits.measure("loose_share", 1 - share), *more]


def _bands(holding: Holding) -> Iterator[str]:
    """Yield what the guideline calls the depth of the deepest pair."""
    deepest = max(holding.held, key=lambda each: each.depth, default=None)
    if deepest and (word := next((word for least, word in _BANDS if deepest.depth >= least), "")):
        yield f"a mean depth of {deepest.depth * 1e3:.2g} mm, of {deepest.name}, is {word}"


def nothing_held(holding: Holding) -> str:
    """Return in words that nothing is held and that nothing stands."""
    start, stop = holding.window
    span = f"from {start:g} to {stop:g} s"
    loose = [each.name for each in holding.bearing]
    if not loose:
        return f"no monitored pair carries force {span}: nothing is held, and nothing stands"
    return (
        f"{span} {', '.join(loose[:3])} carry force, but intermittently, while sliding or while "
        "falling: nothing is held; a scene that holds something declares it under `hold`"
    )


def shorter_steps(checked: CheckedModel, _: CheckResult) -> Iterator[Values]:
    """Yield shares of the timestep, against an engine that stops."""
    yield from ({"timestep": checked.resolved.timestep * share} for share in _SHARES)


def harder(checked: CheckedModel, result: CheckResult) -> Iterator[Values]:
    """Yield changes against chatter, the cheapest first."""
    yield HARD
    yield from shorter_steps(checked, result)


def firmer(_: CheckedModel, __: CheckResult) -> Iterator[Values]:
    """Yield changes against slip and depth, the cheapest first."""
    yield FIRM
    yield FIRMEST
