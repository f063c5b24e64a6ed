"""Converts an error budget to its stored report."""

import math
from collections.abc import Sequence

from contactlab.budget.fixes import TriedFix
from contactlab.budget.readings import ErrorBudget, PhaseBudget, Reading
from contactlab.budget.verdict import Verdict
from contactlab.schema.error_budget import (
    BudgetFix,
    BudgetPhase,
    BudgetReport,
    BudgetRow,
    BudgetWarning,
)
from contactlab.store.table_layout import axis_cell


def budget_report(
    budget: ErrorBudget, verdict: Verdict, tried_fixes: Sequence[TriedFix] = ()
) -> BudgetReport:
    """Return the report of a budget, its verdict and the fixes that were tried."""
    return BudgetReport(
        tolerance=verdict.tolerance,
        verdict=verdict.word,
        reasons=verdict.reasons,
        fixes=tuple(map(fix_report, tried_fixes)),
        phases=tuple(_build_phase(phase, verdict.tolerance) for phase in budget.phases),
    )


def fix_report(fix: TriedFix) -> BudgetFix:
    """Return the report of a fix that was tried."""
    return BudgetFix(
        name=fix.name,
        changes_model=fix.changes_model,
        settings={name: axis_cell(value) for name, value in fix.edits.settings.items()},
        removes=fix.removes,
        verdict=fix.word,
        error=fix.error,
        distance_to_reference=fix.distance,
        distance_before=fix.distance_before,
        time_ratio=fix.time_ratio,
    )


def _build_phase(phase: PhaseBudget, tolerance: float) -> BudgetPhase:
    return BudgetPhase(
        name=phase.name,
        timestep=phase.timestep,
        steps=phase.steps,
        seeds=len(phase.energy),
        seeds_above=int((phase.run.seeds > tolerance).sum()),
        window=phase.window,
        windows=phase.windows,
        bodies=phase.bodies,
        numerical_error=_build_row(phase, phase.run),
        rows=tuple(_build_row(phase, reading) for reading in phase.rows),
        energy_drift=phase.energy_drift,
        excess_path=float(phase.excess_path.max()),
        worst_window=phase.worst_window,
        upper_bound=phase.upper_bound,
        limit_factor=phase.limit_factor,
        invalid_windows=phase.invalid_windows,
        warnings=tuple(
            BudgetWarning(
                kind=warning.kind,
                place=warning.place,
                cause=warning.cause,
                seed=warning.seed,
                time=warning.time,
            )
            for warning in phase.warnings
        ),
    )


def _build_row(phase: PhaseBudget, reading: Reading) -> BudgetRow:
    is_exercised = reading.exercised
    seeds = (float(reading.seeds.min()), float(reading.seeds.max())) if reading.seeds.size else None
    return BudgetRow(
        name=reading.name,
        summary=reading.summary,
        kind=reading.kind,
        exercised=is_exercised,
        infinite=math.isinf(reading.error),
        error=reading.error,
        seeds=seeds if seeds and all(map(math.isfinite, seeds)) else None,
        median=reading.median,
        by_mass=phase.by_mass(reading),
        body=phase.bodies[reading.body] if is_exercised else None,
        place=reading.place or None,
        speed=reading.speed,
        seed=reading.seed if is_exercised else None,
        time=reading.time,
        time_ratio=reading.time_ratio,
    )
