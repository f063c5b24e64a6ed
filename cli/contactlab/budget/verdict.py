"""Derives the verdict and its reasons from an error budget and a tolerance."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from contactlab.budget.readings import ErrorBudget, Origin, PhaseBudget
from contactlab.modifications.catalogue import list_rows
from contactlab.rendering.amounts import format_above, format_percent
from contactlab.schema.error_budget import BudgetReason
from contactlab.schema.verdict import VERDICT_ORDER, VerdictWord

TOLERANCE = 0.1


@dataclass(frozen=True)
class Verdict:
    """The verdict of a budget under a tolerance, with its reasons, the largest first."""

    word: VerdictWord
    tolerance: float
    reasons: tuple[BudgetReason, ...]


def judge(
    budget: ErrorBudget, tolerance: float = TOLERANCE, intended: Sequence[str] = ()
) -> Verdict:
    """Judge a budget; `intended` are rows of modeling choices that the user declares.

    "inaccurate" says that the run is not the motion of its model, "undecided" that the reference
    has not converged, "depends" that a modeling choice changes the motion, and "ok" that nothing
    was found.
    """
    reasons = sorted(
        (reason for phase in budget.phases for reason in _list_reasons(phase, tolerance, intended)),
        key=lambda reason: (VERDICT_ORDER.index(reason.verdict), -abs(reason.error)),
    )
    word = reasons[0].verdict if reasons else "ok"
    return Verdict(word, tolerance, tuple(reasons))


def _list_reasons(
    phase: PhaseBudget, tolerance: float, intended: Sequence[str]
) -> Iterator[BudgetReason]:
    for warning in phase.warnings:
        at = f" at {warning.place}" if warning.place else ""
        body = phase.bodies[phase.run.body]
        where = Origin(body, warning.cause or warning.place, warning.time)
        sentence = f"MuJoCo warned of {warning.kind}{at}"
        yield build_reason("inaccurate", phase.name, "warning", np.inf, where, sentence)
    yield from _numerical_reasons(phase, tolerance)
    alternatives = {row.name: row.alternative for row in list_rows()}
    for row in phase.rows:
        if row.kind == "model" and row.name not in intended and row.error > tolerance:
            where = Origin(phase.bodies[row.body], row.place, row.time)
            alternative = alternatives.get(row.name, row.name)
            size = format_above(row.error, tolerance)
            sentence = f"{alternative} changes the forces on {where.body} by {size}"
            yield build_reason("depends", phase.name, row.name, row.error, where, sentence)


def build_reason(
    verdict: VerdictWord, phase: str, row: str, error: float, where: Origin, sentence: str
) -> BudgetReason:
    """Build the reason for a verdict: a row in a phase, and where its error is largest."""
    return BudgetReason(
        verdict=verdict, phase=phase, row=row, error=error, sentence=sentence, **where._asdict()
    )


def _numerical_reasons(phase: PhaseBudget, tolerance: float) -> Iterator[BudgetReason]:
    run = phase.run
    where = Origin(phase.bodies[run.body], run.place, run.time)
    if run.error > tolerance and not phase.warnings:
        sentence = f"numerical error {format_above(run.error, tolerance)} in {where.body}"
        yield build_reason("inaccurate", phase.name, run.name, run.error, where, sentence)
    drift = phase.energy_drift
    if abs(drift) > tolerance:
        origin = phase.energy_origin
        sign = "+" if drift > 0 else "-"
        size = format_above(abs(drift), tolerance)
        sentence = f"energy drift {sign}{size}, most in {origin.body}"
        yield build_reason("inaccurate", phase.name, "energy", drift, origin, sentence)
    if phase.invalid_windows:
        sentence = f"the reference fails in {format_percent(phase.invalid_windows)} of the windows"
        yield build_reason(
            "undecided", phase.name, "reference", phase.invalid_windows, where, sentence
        )
    elif run.error <= tolerance < phase.doubt:
        sentence = "the reference fails at an eighth of the time step"
        if np.isfinite(phase.upper_bound):
            size = format_above(phase.upper_bound, tolerance)
            sentence = f"the numerical error may be up to {size} in {where.body}"
        yield build_reason("undecided", phase.name, "reference", phase.upper_bound, where, sentence)
