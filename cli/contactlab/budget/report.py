"""A budget as the report that is stored."""

import math
from collections.abc import Sequence

from contactlab.budget.prices import Price
from contactlab.budget.readings import ErrorBudget, PhaseBudget, Reading
from contactlab.budget.remedies import Remedy
from contactlab.budget.verdict import Reason, Verdict
from contactlab.schema.error_budget import (
    BudgetPhase,
    BudgetPrice,
    BudgetReason,
    BudgetRemedy,
    BudgetReport,
    BudgetRow,
    BudgetWarning,
)
from contactlab.store.table_layout import as_written


def budget_report(
    budget: ErrorBudget, verdict: Verdict, tried: Sequence[Remedy] = ()
) -> BudgetReport:
    """Return the report of a budget, its verdict and what was tried against it."""
    return BudgetReport(
        within=verdict.within,
        verdict=verdict.word,
        reasons=tuple(map(_reason, verdict.reasons)),
        remedies=tuple(map(remedy_report, tried)),
        phases=tuple(map(_phase, budget.phases)),
    )


def _finite(number: float) -> float | None:
    return float(number) if math.isfinite(number) else None


def _price(price: Price | None) -> BudgetPrice | None:
    return price and BudgetPrice(ratio=price.ratio, low=price.low, high=price.high)


def _reason(reason: Reason) -> BudgetReason:
    return BudgetReason(
        word=reason.word,
        phase=reason.phase,
        row=reason.row,
        share=_finite(reason.share),
        body=reason.body,
        place=reason.place,
        time=_finite(reason.time),
        sentence=reason.sentence,
    )


def remedy_report(remedy: Remedy) -> BudgetRemedy:
    """Return what is stored of a change that was tried."""
    return BudgetRemedy(
        name=remedy.name,
        physics=remedy.physics,
        settings={name: as_written(value) for name, value in remedy.edits.settings.items()},
        removes=remedy.removes,
        word=remedy.word,
        share=_finite(remedy.share),
        apart=_finite(remedy.apart),
        before=_finite(remedy.before),
        price=_price(remedy.price),
    )


def _phase(phase: PhaseBudget) -> BudgetPhase:
    return BudgetPhase(
        name=phase.name,
        timestep=phase.timestep,
        steps=phase.steps,
        seeds=len(phase.energy),
        window=phase.window,
        windows=phase.windows,
        bodies=phase.bodies,
        run=_row(phase, phase.run),
        rows=tuple(_row(phase, reading) for reading in phase.rows),
        energy=_finite(phase.energy_share),
        excess=_finite(float(phase.excess.max())),
        peak=_finite(phase.peak),
        most=_finite(phase.most),
        limit=phase.limit,
        lost=phase.lost,
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


def _row(phase: PhaseBudget, reading: Reading) -> BudgetRow:
    known = reading.exercised
    seeds = (float(reading.seeds.min()), float(reading.seeds.max())) if reading.seeds.size else None
    return BudgetRow(
        name=reading.name,
        summary=reading.summary,
        kind=reading.kind,
        exercised=known,
        infinite=math.isinf(reading.share),
        share=_finite(reading.share),
        seeds=seeds if seeds and all(map(math.isfinite, seeds)) else None,
        median=_finite(reading.median),
        by_mass=_finite(phase.by_mass(reading)),
        body=phase.bodies[reading.body] if known else None,
        place=reading.place or None,
        speed=_finite(reading.speed),
        seed=reading.seed if known else None,
        time=_finite(reading.time),
        price=_price(reading.price),
    )
