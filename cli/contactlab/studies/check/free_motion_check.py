"""Check 2: is the energy of each kinematic tree conserved in free motion."""

import math
from collections.abc import Iterator, Sequence
from itertools import product

from contactlab.scene.written_inertia import InertiaFault
from contactlab.schema.check_report import CheckResult, Measure
from contactlab.studies.check.check_results import check_result, informative
from contactlab.studies.check.checked_model import CheckedModel
from contactlab.studies.check.free_motion_runs import (
    BEST,
    FreeMotionRun,
    convergence_order,
    free_motions,
    is_accounted,
    motion_name,
    switched_off,
    why_not_applicable,
)
from contactlab.studies.check.inertia import inertia_faults, scene_inertia_faults
from contactlab.studies.session import Values

NAME = "free_motion"
_ASKS = "in free motion, the energy of each kinematic tree drifts by at most 0.1 % a second"
_IMPOSSIBLE = ("not_positive", "triangle", "balanced")
"""Faults of an inertia itself; the others compare it with shapes, which are simplified."""


def check_free_motion(checked: CheckedModel) -> CheckResult:
    """Run the model with nothing but springs and inertia, and compare the energy of each tree.

    A drift is the change of a tree's energy per its peak kinetic energy and time. The gain is that
    of the model with its own damping.
    """
    faults = inertias(checked)
    impossible = [
        Measure(
            name=f"inertia_{each.kind}",
            of=each.body,
            value=each.value,
            unit=each.unit,
            limit=float(each.limit),
            holds=False,
            severity="error",
        )
        for each in faults
        if each.kind in _IMPOSSIBLE
    ]
    notes = [f"body '{each.body}': {each.reason}" for each in faults]
    if reason := why_not_applicable(checked):
        return check_result(NAME, _ASKS, impossible, [reason, *notes])
    free, kept = free_motions(checked, NAME)
    stores = checked.stores(NAME)
    if free[0].tried.is_complete and not free[0].budgets:
        reason = "nothing moves: no joint can be set in motion"
        return check_result(NAME, _ASKS, [], [reason, *notes], stores)
    measures = [
        *_drifts(checked, free),
        *_gains(checked, free[0], kept),
        *_orders(free),
        *impossible,
    ]
    return check_result(NAME, _ASKS, measures, [switched_off(checked), *notes], stores)


def inertias(checked: CheckedModel) -> list[InertiaFault]:
    """Return the faults of inertias, as the model file has them and as simulated."""
    written = scene_inertia_faults(checked.scene.source, checked.resolved.structure)
    simulated = inertia_faults(checked.prepared.model)
    return list({(each.body, each.kind): each for each in (*simulated, *written)}.values())


def _named(tree: str, budgets: Sequence[str], what: str) -> str:
    return what if len(budgets) == 1 else f"{tree}, {what}"


def _drifts(checked: CheckedModel, free: Sequence[FreeMotionRun]) -> Iterator[Measure]:
    nominal, *others = free
    if not nominal.budgets:
        yield checked.limits.measure("energy_drift", math.inf, nominal.name)
    trees = list(nominal.budgets)
    for tree, budget in nominal.budgets.items():
        name = _named(tree, trees, nominal.name)
        drift = abs(budget.rate(budget.peak))
        yield checked.limits.measure("energy_drift", drift, name)
        yield informative("energy_deviation_max", budget.most / budget.peak, "1", name)
    for motion, tree in product(others, trees):
        found = motion.budgets.get(tree)
        drift = abs(found.rate(found.peak)) if found else math.inf
        yield informative("energy_drift", drift, "1/s", _named(tree, trees, motion.name))


def _gains(checked: CheckedModel, nominal: FreeMotionRun, kept: FreeMotionRun) -> Iterator[Measure]:
    """Yield the gain with the model's own damping, and its budget, per free kinetic energy."""
    if not kept.budgets:
        yield checked.limits.measure("energy_gain", math.inf, kept.name)
    trees, what = list(kept.budgets), kept.name + (", damping on" if kept.damped else "")
    for tree, budget in kept.budgets.items():
        peak = nominal.budgets.get(tree, budget).peak
        name = _named(tree, trees, what)
        yield checked.limits.measure("energy_gain", budget.rate(peak), name)
        if kept.damped and is_accounted(checked):
            work = -budget.dampers / peak / budget.seconds
            yield informative("work_of_dampers", work, "1/s", name)
            yield informative("energy_unexplained", budget.unexplained(peak), "1/s", name)


def _orders(free: Sequence[FreeMotionRun]) -> Iterator[Measure]:
    for integrator in dict.fromkeys(each.integrator for each in free):
        traces = [
            each.tried.trace for each in free if each.integrator == integrator and each.budgets
        ]
        if len(traces) == 3:
            yield informative("convergence_order", convergence_order(*traces), "1", integrator)


def steadier(checked: CheckedModel, result: CheckResult) -> Iterator[Values]:
    """Yield integrators and timesteps, the cheapest first, but those that are known to miss.

    No integrator mends an inertia that no body can have.
    """
    drifts = [each for each in result.measures if each.name == "energy_drift"]
    limit = next((each.limit for each in drifts if each.limit is not None), math.inf)
    own, timestep = str(checked.settings["integrator"]), checked.resolved.timestep
    if any(each.name.startswith("inertia") for each in result.measures):
        return
    for integrator, share in ((own, 2), (BEST, 1), (own, 4), (BEST, 2)):
        name = motion_name(integrator, timestep / share)
        found = [each.value for each in drifts if (each.of or "").endswith(name)]
        if all(value is not None and value <= limit for value in found):
            step = {} if share == 1 else {"timestep": timestep / share}
            yield step if integrator == own else {"integrator": integrator, **step}
