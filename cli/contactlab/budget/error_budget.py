"""An error budget: how far a run is, window by window, from the motion of its own model.

docs/theory/error-budget.md derives the definitions and studies each choice.
"""

import os
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import mujoco

from contactlab.budget.measuring import PhaseMeasure, Settings
from contactlab.budget.motion import Motion
from contactlab.budget.readings import ErrorBudget, PhaseBudget
from contactlab.budget.time_ratios import QUICK_PROTOCOL, measure_time_ratios
from contactlab.budget.windows import Run, without_sensors
from contactlab.errors import EngineError
from contactlab.modifications.catalogue import list_rows
from contactlab.modifications.modification import Row
from contactlab.scene.mujoco_versions import silence_mujoco

SETTINGS = Settings()


def error_budget(
    motions: Sequence[Motion],
    *,
    rows: Sequence[str] | None = None,
    settings: Settings = SETTINGS,
    workers: int | None = None,
    original: mujoco.MjModel | None = None,
) -> ErrorBudget:
    """Return the budget of a task's phases.

    Args:
        motions: the phases.
        rows: names of rows of the catalogue of modifications; all by default.
        settings: how it is measured.
        workers: threads; one for each processor by default. Nothing but prices depends on them.
        original: the model of the references, if the motions are those of a changed model.

    Raises:
        EngineError: nothing moves that has mass, a row is unknown, or the engine refuses a batch.
    """
    row_names = [row.name for row in list_rows()]
    for name in rows or ():
        EngineError.unless_known(name, row_names, f"no row of a budget is called {name!r}")
    chosen_rows = [row for row in list_rows() if rows is None or row.name in rows]
    silence_mujoco()
    settings = replace(settings, workers=workers or os.cpu_count() or 1)
    phases, runs = list[PhaseBudget](), list[Run]()
    for motion in motions:  # one after the other: each measure holds models
        measure = PhaseMeasure(motion, chosen_rows, settings, original=original)
        phases.append(measure.measure_budget())
        runs.append(measure.run)
    budget = ErrorBudget(tuple(phases))
    if not settings.measures_time:
        return budget
    timed_phases = map(partial(_time_rows, budget, chosen_rows), motions, runs, phases)
    return ErrorBudget(tuple(timed_phases))


def _time_rows(
    budget: ErrorBudget, rows: Sequence[Row], motion: Motion, run: Run, phase: PhaseBudget
) -> PhaseBudget:
    def change_model(row: Row) -> mujoco.MjModel:
        changed = without_sensors(motion.model)
        row.changes[0](changed, motion.model)
        return changed

    # A row is timed only in the phase that has its largest reading.
    loaded = {reading.name for reading in phase.rows if reading.exercised}
    changed_models = {
        row.name: (partial(change_model, row), 1)
        for row in rows
        if row.has_time and row.name in loaded
        if (worst := budget.worst(row.name)) and worst[0] is phase
    }
    if not changed_models:
        return phase
    ratios = measure_time_ratios(motion, run, changed_models, QUICK_PROTOCOL)
    timed_rows = (replace(reading, time_ratio=ratios.get(reading.name)) for reading in phase.rows)
    return replace(phase, rows=tuple(timed_rows))
