"""What a budget says under one tolerance, and why."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from contactlab.budget.readings import ErrorBudget, PhaseBudget
from contactlab.printable import percent, plain

TOLERANCE = 0.1

Word = Literal["unresolved", "not resolved", "model", "sound"]
_ORDER: tuple[Word, ...] = get_args(Word)


@dataclass(frozen=True)
class Reason:
    """Why a verdict is not "sound".

    Attributes:
        word: the verdict that it alone would give.
        phase, row: which number is above the tolerance; a row, "run", "energy", "reference" or
            "warning".
        share: that number.
        body, place, time: where and when it is largest; "" and NaN where that is not known.
        sentence: says it.
    """

    word: Word
    phase: str
    row: str
    share: float
    body: str
    place: str
    time: float
    sentence: str


@dataclass(frozen=True)
class Verdict:
    """What a budget says under a tolerance: a word, and the reasons for it, the largest first."""

    word: Word
    within: float
    reasons: tuple[Reason, ...]


def judge(budget: ErrorBudget, within: float = TOLERANCE, meant: Sequence[str] = ()) -> Verdict:
    """Judge a budget under a tolerance; `meant` are rows of the model whose softness is declared.

    "unresolved" says that the run is not the motion of its model, "not resolved" that not even the
    reference is known to be, "model" that the result hangs on how rigid or regularised the model
    is, "sound" that none of it was found.
    """
    reasons = sorted(
        (reason for phase in budget.phases for reason in _reasons(phase, within, meant)),
        key=lambda reason: (_ORDER.index(reason.word), -abs(reason.share)),
    )
    word = reasons[0].word if reasons else "sound"
    return Verdict(word, within, tuple(reasons))


def _reasons(phase: PhaseBudget, within: float, meant: Sequence[str]) -> Iterator[Reason]:
    yield from _warned(phase)
    yield from _numerical(phase, within)
    for row in phase.rows:
        if row.kind == "model" and row.name not in meant and row.share > within:
            body = phase.bodies[row.body]
            sentence = (
                f"{percent(row.share)} of the motion of {body} hangs on {row.name}: "
                f"{plain(1e3 * row.speed)} mm/s"
            )
            where = body, row.place, row.time
            yield Reason("model", phase.name, row.name, row.share, *where, sentence)


def _warned(phase: PhaseBudget) -> Iterator[Reason]:
    body = phase.bodies[phase.run.body]
    for warning in phase.warnings:
        at = f" at {warning.place}" if warning.place else ""
        sentence = f"MuJoCo warned of {warning.kind}{at}"
        if warning.cause and warning.cause != warning.place:
            sentence += f"; forces parted first at {warning.cause}"
        where = body, warning.cause or warning.place, warning.time
        yield Reason("unresolved", phase.name, "warning", np.inf, *where, sentence)


def _numerical(phase: PhaseBudget, within: float) -> Iterator[Reason]:
    run, name = phase.run, phase.name
    body = phase.bodies[run.body]
    where = body, run.place, run.time
    if run.share > within and not phase.warnings:
        sentence = f"{body} moves under phantom forces of {percent(run.share)} of the real ones"
        yield Reason("unresolved", name, "run", run.share, *where, sentence)
    energy = phase.energy_share
    if abs(energy) > within:
        verb = "gains" if energy > 0 else "loses"
        origin = phase.energy_from
        sentence = (
            f"energy: the run {verb} {percent(abs(energy))} that the model does not, most in "
            f"{origin.body}"
        )
        yield Reason("unresolved", name, "energy", energy, *origin, sentence)
    if phase.lost:
        sentence = f"the reference itself gives up in {percent(phase.lost)} of the windows"
        yield Reason("not resolved", name, "reference", phase.lost, *where, sentence)
    elif run.share <= within < phase.most:
        sentence = "the reference itself gives up at an eighth of the step"
        if np.isfinite(phase.most):
            sentence = (
                "references at a quarter and an eighth of the step differ, so that "
                f"the run may be off by {percent(phase.most)}"
            )
        yield Reason("not resolved", name, "reference", phase.most, *where, sentence)
