"""Check 2: is energy conserved in free motion, and what changes it if not."""

from collections.abc import Iterator, Sequence

import numpy as np

from contactlab.scene.written_inertia import InertiaFault
from contactlab.schema.check_report import Change, CheckResult, Measure
from contactlab.studies.check.check_results import (
    change,
    check_result,
    informative,
    not_applicable,
    upper_limit,
)
from contactlab.studies.check.checked_model import CheckedModel, CheckRunner
from contactlab.studies.check.free_motion_runs import (
    BEST,
    SECONDS,
    FreeMotionRun,
    convergence_order,
    free_flying_bodies,
    free_motions,
    is_accounted,
    why_not_applicable,
)
from contactlab.studies.check.inertia import inertia_faults, scene_inertia_faults

NAME = "free_motion"
DRIFT = 1e-3
"""Largest accepted change of energy, as a fraction of peak kinetic energy a second [1/s]."""

_ASKS = "in free motion, energy drifts by at most 0.1 % of peak kinetic energy a second"
_IMPOSSIBLE = ("not_positive", "triangle", "balanced")
"""Faults of an inertia itself; the others compare it with shapes, which are simplified."""

_STILL = 1e-6
"""Kinetic energy per mass [J/kg] below which nothing moves: about 1 mm/s."""

_MOSTLY = 0.9
"""Fraction of the peak kinetic energy due to falling, above which the rest hardly counts."""


def check_free_motion(runner: CheckRunner) -> CheckResult:
    """Run the model with nothing but gravity, springs and inertia, and compare its energy."""
    checked = runner.checked
    if reason := why_not_applicable(checked):
        return not_applicable(NAME, _ASKS, reason)
    motions = free_motions(runner, NAME)
    nominal, stores = motions[0], runner.stores(NAME)
    if nominal.budget and nominal.budget.peak <= _STILL * _mass(checked):
        reason = "nothing moves by itself from this initial state; choose one from which it falls"
        return not_applicable(NAME, _ASKS, reason, stores=stores)
    free = [each for each in motions if not each.damped]
    damped = next((each for each in motions if each.damped), None)
    faults = inertias(checked)
    impossible = [each for each in faults if each.kind in _IMPOSSIBLE]
    return check_result(
        NAME,
        _ASKS,
        _reason(free, damped, impossible),
        [
            *_drifts(free),
            *_orders(free),
            *_dampers(nominal, damped, accounted=is_accounted(checked)),
            *map(_impossible, impossible),
        ],
        changes=[] if nominal.drift <= DRIFT or impossible else list(_remedies(checked, free)),
        notes=[
            *(f"body '{each.body}': {each.reason}" for each in faults),
            *_exclusion_notes(checked, nominal),
        ],
        stores=stores,
    )


def percent(rate: float) -> str:
    """Return a rate [1/s] in percent per second, signed, with two digits."""
    return f"{rate * 100:+.2g} %/s"


def inertias(checked: CheckedModel) -> list[InertiaFault]:
    """Return the faults of inertias, as the model file has them and as simulated."""
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


def _description(motion: FreeMotionRun) -> str:
    if motion.budget is None:
        return f"the run with {motion.name} is not complete: {motion.tried.record.status_reason}"
    return f"with {motion.name} energy drifts by {percent(_rate(motion))} of its kinetic peak"


def _reason(
    free: Sequence[FreeMotionRun], damped: FreeMotionRun | None, faults: Sequence[InertiaFault]
) -> str:
    nominal = free[0]
    parts = [f"{_description(nominal)} (limit 0.1 %/s)"]
    if faults:
        names = ", ".join(f"'{each.body}'" for each in faults)
        parts.insert(
            0,
            f"the inertia of {names} belongs to no physical body; correct it before the integrator",
        )
    accurate = [each for each in free if each.drift <= DRIFT]
    if nominal.drift > DRIFT and not faults:
        parts += [f"{each.name} meets it, with {percent(_rate(each))}" for each in accurate[:1]]
    if damped is not None and damped.budget is not None and nominal.budget is not None:
        change = damped.budget.rate(nominal.budget.peak)
        verb = "falls" if change < 0 else "rises"
        hides = nominal.drift > DRIFT and change < 0
        parts.append(
            f"with the model's own damping on, the energy {verb} by {percent(abs(change))[1:]}"
            + (", which hides that drift" if hides else "")
        )
    return "; ".join(parts)


def _rate(motion: FreeMotionRun) -> float:
    return motion.budget.rate(motion.budget.peak) if motion.budget else np.nan


def _drifts(free: Sequence[FreeMotionRun]) -> Iterator[Measure]:
    nominal, *others = free
    yield upper_limit("energy_drift", nominal.drift, "1/s", DRIFT, nominal.name)
    if nominal.budget:
        most = nominal.budget.most / nominal.budget.peak
        yield informative("energy_deviation_max", most, "1", nominal.name)
    yield from (informative("energy_drift", each.drift, "1/s", each.name) for each in others)


def _orders(free: Sequence[FreeMotionRun]) -> Iterator[Measure]:
    for integrator in dict.fromkeys(each.integrator for each in free):
        whole = [each for each in free if each.integrator == integrator and each.budget]
        traces = [each.tried.trace for each in whole]
        if len(traces) == 3:
            yield informative("convergence_order", convergence_order(*traces), "1", integrator)


def _dampers(
    nominal: FreeMotionRun, damped: FreeMotionRun | None, *, accounted: bool
) -> Iterator[Measure]:
    """Yield the energy budget with damping, as fractions of the free motion's kinetic energy."""
    if damped is None or damped.budget is None or nominal.budget is None:
        return
    name, budget, peak = f"{damped.name}, damping on", damped.budget, nominal.budget.peak
    yield informative("energy_change", budget.rate(peak), "1/s", name)
    if accounted:
        yield informative("work_of_dampers", -budget.dampers / peak / budget.seconds, "1/s", name)
        yield informative("energy_unexplained", budget.unexplained(peak), "1/s", name)


def _remedies(checked: CheckedModel, free: Sequence[FreeMotionRun]) -> Iterator[Change]:
    """Yield what meets the limit: RK4 at this timestep, or a smaller timestep."""
    nominal = free[0]
    accurate = [each for each in free if each.drift <= DRIFT]
    better = [each for each in accurate if each.integrator == BEST][:1]
    smaller = [each for each in accurate if each.integrator == nominal.integrator != BEST][:1]
    for each in (*better, *smaller):
        settings: dict[str, object] = {}
        if each.integrator != nominal.integrator:
            settings["integrator"] = each.integrator
        if each.timestep != nominal.timestep:
            settings["timestep"] = each.timestep
        yield change(checked, settings, cures=True, shown=_description(each))


def _exclusion_notes(checked: CheckedModel, nominal: FreeMotionRun) -> Iterator[str]:
    """Yield whose energy is left out, and whether falling dominates the rest."""
    model = checked.prepared.model
    apart = free_flying_bodies(checked)
    if apart:
        names = ", ".join(f"'{model.body(each).name}'" for each in apart)
        yield f"the energy of {names}, flying by itself, is left out"
    mass = sum(checked.free_masses) - float(model.body_subtreemass[list(apart)].sum())
    if nominal.budget is None or mass <= 0 or model.nv == 6 * len(checked.free_masses):
        return
    share = 0.5 * mass * (np.linalg.norm(model.opt.gravity) * SECONDS) ** 2 / nominal.budget.peak
    if share >= _MOSTLY:
        yield (
            f"{min(share, 1):.0%} of the peak kinetic energy is the fall of floating mechanisms, "
            "next to which the drift of their joints is small"
        )
