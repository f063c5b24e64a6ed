"""The backward error of a scene's run, as a metric: one number of its budget, and no rows."""

from contactlab.budget.error_budget import error_budget
from contactlab.budget.measuring import Settings
from contactlab.budget.motion import motion_of_run
from contactlab.contact.trace_arrays import BackwardError
from contactlab.engines.engine import PreparedRuns
from contactlab.errors import EngineError

_ALONE = Settings(check=False, energy=False, places=False)
_NOTHING_MOVES = BackwardError(float("nan"), "", float("nan"), float("nan"))


def backward_error(runs: PreparedRuns, run: int) -> BackwardError:
    """Return the backward error of a run, against references at a quarter of its step.

    Its budget alone, without what tells how well the reference is resolved: docs/budget.md. NaN
    where nothing moves that has mass.
    """
    try:
        motion = motion_of_run(runs.models[run], runs.starts, run, runs.steps)
        (phase,) = error_budget([motion], rows=(), settings=_ALONE, workers=1).phases
    except EngineError:
        return _NOTHING_MOVES
    worst = phase.run
    return BackwardError(worst.share, phase.bodies[worst.body], worst.time, phase.energy_share)
