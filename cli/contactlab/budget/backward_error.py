"""The numerical error of a scene's run as a metric: its error budget without rows."""

from collections.abc import Sequence

from contactlab.budget.measuring import PhaseMeasure, Settings
from contactlab.budget.motion import motion_of_run
from contactlab.contact.trace_arrays import BackwardError, ChoiceEffect, Floats
from contactlab.engines.engine import PreparedRuns
from contactlab.errors import EngineError
from contactlab.modifications.catalogue import list_rows
from contactlab.modifications.modification import Row

_ALONE = Settings(check=False, energy=False, places=False, excess=False)
_NAN = float("nan")
_NOTHING_MOVES = BackwardError(_NAN, "", _NAN, _NAN, "", _NAN)


def backward_error(runs: PreparedRuns, run: int, states: Floats | None = None) -> BackwardError:
    """Return the backward error of a run, against references at a quarter of its step.

    The references are not checked, and the budget has no rows: docs/how-to/budget.md. NaN
    where nothing moves that has mass. The run is repeated where its `states` are not given, which
    are (N + 1, nstate) of mjSTATE_INTEGRATION, before each step and after the last.
    """
    return _measure_run(runs, run, states, ())


def whole_verdict(runs: PreparedRuns, run: int, states: Floats | None = None) -> BackwardError:
    """Return the backward error of a run with the effects of modeling choices."""
    rows = [row for row in list_rows() if row.kind == "model"]
    return _measure_run(runs, run, states, rows)


def _measure_run(
    runs: PreparedRuns, run: int, states: Floats | None, rows: Sequence[Row]
) -> BackwardError:
    try:
        motion = motion_of_run(runs.models[run], runs.starts, run, runs.steps)
        known_states = None if states is None else states[None]
        phase = PhaseMeasure(motion, rows, _ALONE, known_states).measure_budget()
    except EngineError:
        return _NOTHING_MOVES
    worst, energy = phase.run, phase.energy_origin
    where = phase.bodies[worst.body], worst.time
    error_of_run = BackwardError(
        worst.error,
        *where,
        phase.energy_drift,
        energy.body,
        energy.time,
        errors=tuple(zip(phase.bodies, worst.errors.tolist(), strict=True)),
    )
    effects = (
        ChoiceEffect(row.name, row.error, phase.bodies[row.body], row.time)
        for row in phase.rows
        if row.exercised
    )
    return error_of_run._replace(effects=tuple(effects)) if rows else error_of_run
