"""An error budget: how far a run is, window by window, from the motion of its own model.

docs/budget-derivation.md derives the definitions and studies each choice.
"""

import os
from collections.abc import Sequence
from dataclasses import replace

from contactlab.budget.measuring import PhaseMeasure, Settings
from contactlab.budget.motion import Motion
from contactlab.budget.readings import ErrorBudget
from contactlab.errors import EngineError
from contactlab.modifications.catalogue import list_rows
from contactlab.scene.mujoco_versions import silence_mujoco

SETTINGS = Settings()


def error_budget(
    motions: Sequence[Motion],
    *,
    rows: Sequence[str] | None = None,
    settings: Settings = SETTINGS,
    workers: int | None = None,
) -> ErrorBudget:
    """Return the budget of a task's phases.

    Args:
        motions: the phases.
        rows: names of rows of the catalogue of modifications; all by default.
        settings: how it is measured.
        workers: threads; one for each processor by default. Nothing but prices depends on them.

    Raises:
        EngineError: nothing moves that has mass, a row is unknown, or the engine refuses a batch.
    """
    known = [row.name for row in list_rows()]
    for name in rows or ():
        EngineError.unless_known(name, known, f"no row of a budget is called {name!r}")
    wanted = [row for row in list_rows() if rows is None or row.name in rows]
    silence_mujoco()
    settings = replace(settings, workers=workers or os.cpu_count() or 1)
    # One after the other: each holds models.
    phases = (PhaseMeasure(motion, wanted, settings).budget() for motion in motions)
    return ErrorBudget(tuple(phases))
