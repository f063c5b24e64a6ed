"""Derives the verdict and its reasons from an error budget and a tolerance."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import get_args

import numpy as np

from contactlab.budget.readings import ErrorBudget, PhaseBudget
from contactlab.modifications.catalogue import list_rows
from contactlab.rendering.amounts import format_above, format_percent
from contactlab.schema.verdict import VerdictWord

TOLERANCE = 0.1
_ORDER: tuple[VerdictWord, ...] = get_args(VerdictWord)


@dataclass(frozen=True)
class Reason:
    """A number that is above the tolerance.

    Attributes:
        word: the verdict that this reason alone would give.
        phase: the phase in which the number is above the tolerance.
        row: a row of the budget, or "energy", "reference" or "warning".
        error: the number.
        body, place, time: where and when it is largest; "" and NaN if that is not known.
        sentence: the reason in at most ten words.
    """

    word: VerdictWord
    phase: str
    row: str
    error: float
    body: str
    place: str
    time: float
    sentence: str


@dataclass(frozen=True)
class Verdict:
    """The verdict of a budget under a tolerance, with its reasons, the largest first."""

    word: VerdictWord
    tolerance: float
    reasons: tuple[Reason, ...]


def judge(
    budget: ErrorBudget, tolerance: float = TOLERANCE, intended: Sequence[str] = ()
) -> Verdict:
    """Judge a budget; `intended` are rows of modeling choices that the user declares.

    "inaccurate" says that the run is not the motion of its model, "undecided" that the reference
    has not converged, "depends" that a modeling choice changes the motion, and "ok" that nothing
    was found.
    """
    reasons = sorted(
        (reason for phase in budget.phases for reason in _reasons(phase, tolerance, intended)),
        key=lambda reason: (_ORDER.index(reason.word), -abs(reason.error)),
    )
    word = reasons[0].word if reasons else "ok"
    return Verdict(word, tolerance, tuple(reasons))


def _reasons(phase: PhaseBudget, tolerance: float, intended: Sequence[str]) -> Iterator[Reason]:
    yield from _warnings(phase)
    yield from _numerical_reasons(phase, tolerance)
    alternatives = {row.name: row.alternative for row in list_rows()}
    for row in phase.rows:
        if row.kind == "model" and row.name not in intended and row.error > tolerance:
            body = phase.bodies[row.body]
            alternative = alternatives.get(row.name, row.name)
            size = format_above(row.error, tolerance)
            sentence = f"{alternative} changes {body}'s motion by {size}"
            where = body, row.place, row.time
            yield Reason("depends", phase.name, row.name, row.error, *where, sentence)


def _warnings(phase: PhaseBudget) -> Iterator[Reason]:
    body = phase.bodies[phase.run.body]
    for warning in phase.warnings:
        at = f" at {warning.place}" if warning.place else ""
        where = body, warning.cause or warning.place, warning.time
        sentence = f"MuJoCo warned of {warning.kind}{at}"
        yield Reason("inaccurate", phase.name, "warning", np.inf, *where, sentence)


def _numerical_reasons(phase: PhaseBudget, tolerance: float) -> Iterator[Reason]:
    run, name = phase.run, phase.name
    body = phase.bodies[run.body]
    where = body, run.place, run.time
    if run.error > tolerance and not phase.warnings:
        sentence = f"numerical error {format_above(run.error, tolerance)} in {body}"
        yield Reason("inaccurate", name, run.name, run.error, *where, sentence)
    drift = phase.energy_drift
    if abs(drift) > tolerance:
        origin = phase.energy_origin
        sign = "+" if drift > 0 else "-"
        size = format_above(abs(drift), tolerance)
        sentence = f"energy drift {sign}{size}, most in {origin.body}"
        yield Reason("inaccurate", name, "energy", drift, *origin, sentence)
    if phase.invalid_windows:
        sentence = f"the reference fails in {format_percent(phase.invalid_windows)} of the windows"
        yield Reason("undecided", name, "reference", phase.invalid_windows, *where, sentence)
    elif run.error <= tolerance < phase.upper_bound:
        sentence = "the reference fails at an eighth of the time step"
        if np.isfinite(phase.upper_bound):
            size = format_above(phase.upper_bound, tolerance)
            sentence = f"the numerical error may be up to {size} in {body}"
        yield Reason("undecided", name, "reference", phase.upper_bound, *where, sentence)
