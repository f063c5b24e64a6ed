"""A budget of the watched bodies alone."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from contactlab.budget import ErrorBudget, PhaseBudget, Reading
from contactlab.errors import EngineError


def of_watched(budget: ErrorBudget, watched: Sequence[str]) -> ErrorBudget:
    """Return a budget in which only the shares of some bodies count; of all if none is named.

    The window of a row, and its spread by seed, are known of its worst body only; where that is not
    watched, they are left out. Energies, warnings and lost windows are of no single body, and stay.

    Raises:
        EngineError: none of the bodies moves and has mass.
    """
    if not watched:
        return budget
    return ErrorBudget(tuple(_phase(phase, watched) for phase in budget.phases))


def _phase(phase: PhaseBudget, watched: Sequence[str]) -> PhaseBudget:
    kept = np.flatnonzero([body in watched for body in phase.bodies])
    if not kept.size:
        raise EngineError(
            f"none of the watched bodies moves and has mass ({', '.join(watched)}); those that do: "
            f"{', '.join(phase.bodies)}"
        )
    return replace(
        phase,
        bodies=tuple(phase.bodies[body] for body in kept),
        masses=phase.masses[kept],
        run=_reading(phase.run, kept),
        rows=tuple(_reading(row, kept) for row in phase.rows),
        excess=phase.excess[kept],
    )


def _reading(row: Reading, kept: np.ndarray) -> Reading:
    if not row.shares.size:
        return row
    shares = row.shares[kept]
    worst = int(np.argmax(np.nan_to_num(shares, nan=-1.0)))
    changed = replace(row, shares=shares, body=worst)
    if kept[worst] == row.body:
        return changed
    return replace(changed, seeds=np.empty(0), speed=np.nan, time=np.nan, place="")
