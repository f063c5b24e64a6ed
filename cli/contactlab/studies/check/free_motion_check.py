"""Check 2: does the model keep its energy in free motion, and what takes it if not."""

from collections.abc import Iterator, Sequence

import numpy as np

from contactlab.scene import InertiaFault
from contactlab.schema import Change, CheckResult, Measure
from contactlab.studies.check.check_results import (
    at_most,
    change,
    informative,
    not_applicable,
    result,
)
from contactlab.studies.check.checked_model import CheckedModel, CheckRunner
from contactlab.studies.check.free_motion_runs import (
    BEST,
    SECONDS,
    FreeMotion,
    convergence_order,
    free_flying_bodies,
    free_motions,
    is_accounted,
    why_not_applicable,
)
from contactlab.studies.check.inertia import inertia_faults, scene_inertia_faults

NAME = "free_motion"
DRIFT = 1e-3
"""Largest change of energy, as a share of peak kinetic energy a second, that practice accepts."""

_ASKS = "in free motion, energy drifts by at most 0.1 % of peak kinetic energy a second"
_IMPOSSIBLE = ("not_positive", "triangle", "balanced")
"""Faults of an inertia by itself; the others are against the shapes, which are simplified."""

_STILL = 1e-6
"""Kinetic energy of a kilogram [J] below which nothing is said to move: about 1 mm/s."""

_MOSTLY = 0.9
"""Share of the peak kinetic energy that is fall, from which the rest hardly counts."""


def check_free_motion(runner: CheckRunner) -> CheckResult:
    """Run the model with nothing but gravity, springs and inertia, and weigh its energy."""
    checked = runner.checked
    if reason := why_not_applicable(checked):
        return not_applicable(NAME, _ASKS, reason)
    motions = free_motions(runner, NAME)
    own, stores = motions[0], runner.stores(NAME)
    if own.ledger and own.ledger.peak <= _STILL * _mass(checked):
        reason = "nothing moves by itself from this start; choose one from which it falls"
        return not_applicable(NAME, _ASKS, reason, stores=stores)
    free = [each for each in motions if not each.damped]
    damped = next((each for each in motions if each.damped), None)
    faults = inertias(checked)
    impossible = [each for each in faults if each.kind in _IMPOSSIBLE]
    return result(
        NAME,
        _ASKS,
        _reason(free, damped, impossible),
        [
            *_drifts(free),
            *_orders(free),
            *_dampers(own, damped, accounted=is_accounted(checked)),
            *map(_impossible, impossible),
        ],
        changes=[] if own.drift <= DRIFT or impossible else list(_cures(checked, free)),
        notes=[
            *(f"body '{each.body}': {each.reason}" for each in faults),
            *_left_out(checked, own),
        ],
        stores=stores,
    )


def percent(rate: float) -> str:
    """Return a rate [1/s] in percent a second, signed, with two digits."""
    return f"{rate * 100:+.2g} %/s"


def inertias(checked: CheckedModel) -> list[InertiaFault]:
    """Return what is wrong with inertias, as written in the model and as simulated."""
    written = scene_inertia_faults(checked.scene.source, checked.resolved.structure)
    simulated = inertia_faults(checked.prepared.model)
    return list({(each.body, each.kind): each for each in (*simulated, *written)}.values())


def _impossible(fault: InertiaFault) -> Measure:
    return Measure(
        name=f"inertia_{fault.kind}",
        of=fault.body,
        value=fault.value,
        unit=fault.unit,
        limit=float(fault.limit),
        holds=False,
    )


def _mass(checked: CheckedModel) -> float:
    return float(checked.prepared.model.body_mass.sum())


def _said(motion: FreeMotion) -> str:
    if motion.ledger is None:
        return f"{motion.name} does not get to the end: {motion.tried.record.status_reason}"
    return f"{motion.name} changes it by {percent(_rate(motion))}"


def _reason(
    free: Sequence[FreeMotion], damped: FreeMotion | None, faults: Sequence[InertiaFault]
) -> str:
    own = free[0]
    parts = [f"of peak kinetic energy, {_said(own)} (limit 0.1 %/s)"]
    if faults:
        names = ", ".join(f"'{each.body}'" for each in faults)
        parts.insert(0, f"the inertia of {names} is that of no body: mend it before the integrator")
    fine = [each for each in free if each.drift <= DRIFT]
    if own.drift > DRIFT and not faults:
        parts += [f"{each.name} meets it, with {percent(_rate(each))}" for each in fine[:1]]
    if damped is not None and damped.ledger is not None and own.ledger is not None:
        change = damped.ledger.rate(own.ledger.peak)
        verb = "falls" if change < 0 else "rises"
        hides = own.drift > DRIFT and change < 0
        parts.append(
            f"with the model's own damping on, the energy {verb} by {percent(abs(change))[1:]}"
            + (", which hides that drift" if hides else "")
        )
    return "; ".join(parts)


def _rate(motion: FreeMotion) -> float:
    return motion.ledger.rate(motion.ledger.peak) if motion.ledger else np.nan


def _drifts(free: Sequence[FreeMotion]) -> Iterator[Measure]:
    own, *others = free
    yield at_most("energy_drift", own.drift, "1/s", DRIFT, own.name)
    if own.ledger:
        most = own.ledger.most / own.ledger.peak
        yield informative("energy_deviation_max", most, "1", own.name)
    yield from (informative("energy_drift", each.drift, "1/s", each.name) for each in others)


def _orders(free: Sequence[FreeMotion]) -> Iterator[Measure]:
    for integrator in dict.fromkeys(each.integrator for each in free):
        whole = [each for each in free if each.integrator == integrator and each.ledger]
        traces = [each.tried.trace for each in whole]
        if len(traces) == 3:
            yield informative("convergence_order", convergence_order(*traces), "1", integrator)


def _dampers(own: FreeMotion, damped: FreeMotion | None, *, accounted: bool) -> Iterator[Measure]:
    """Yield the ledger with damping on, as shares of the free motion's peak kinetic energy."""
    if damped is None or damped.ledger is None or own.ledger is None:
        return
    name, ledger, peak = f"{damped.name}, damping on", damped.ledger, own.ledger.peak
    yield informative("energy_change", ledger.rate(peak), "1/s", name)
    if accounted:
        yield informative("work_of_dampers", -ledger.dampers / peak / ledger.seconds, "1/s", name)
        yield informative("energy_unexplained", ledger.unexplained(peak), "1/s", name)


def _cures(checked: CheckedModel, free: Sequence[FreeMotion]) -> Iterator[Change]:
    """Yield what meets the limit: the best integrator at this timestep, or a smaller timestep."""
    own = free[0]
    fine = [each for each in free if each.drift <= DRIFT]
    better = [each for each in fine if each.integrator == BEST][:1]
    smaller = [each for each in fine if each.integrator == own.integrator != BEST][:1]
    for each in (*better, *smaller):
        settings: dict[str, object] = {}
        if each.integrator != own.integrator:
            settings["integrator"] = each.integrator
        if each.timestep != own.timestep:
            settings["timestep"] = each.timestep
        yield change(checked, settings, cures=True, shown=_said(each))


def _left_out(checked: CheckedModel, own: FreeMotion) -> Iterator[str]:
    """Say whose energy is left out, and if the fall of floating mechanisms is most of the rest."""
    model = checked.prepared.model
    apart = free_flying_bodies(checked)
    if apart:
        names = ", ".join(f"'{model.body(each).name or each}'" for each in apart)
        yield f"the energy of {names}, flying by itself, is left out"
    mass = sum(checked.free_masses) - float(model.body_subtreemass[list(apart)].sum())
    if own.ledger is None or mass <= 0 or model.nv == 6 * len(checked.free_masses):
        return
    share = 0.5 * mass * (np.linalg.norm(model.opt.gravity) * SECONDS) ** 2 / own.ledger.peak
    if share >= _MOSTLY:
        yield (
            f"{min(share, 1):.0%} of the peak kinetic energy is the fall of floating mechanisms, "
            "next to which the drift of their joints is small"
        )
