"""How many steps the passes after the runs will take, and how long the clock of one runs."""

from contactlab.run.accuracy import families
from contactlab.run.jobs import Planned
from contactlab.run.stopwatch import LEAST, MOST, SINGLE
from contactlab.scene import ResolvedRun, Scene
from contactlab.schema import AccuracyAsk, TimingAsk

# RK4 takes four evaluations a step.
_EVALUATIONS = 4


def accuracy_steps(ask: AccuracyAsk | None, planned: Planned, scene: Scene) -> float:
    """Return the steps of all references, in evaluations, and of the runs held against them."""
    if ask is None:
        return 0.0
    resolved = {run.run_id: each for run, each in planned}
    found = [[resolved[run.run_id] for run in job] for job in families(planned, scene)]
    return sum(_steps(family, ask.refine) for family in found)


def timing_seconds(ask: TimingAsk | None, planned: Planned, per_step: float) -> float:
    """Return how long runs are timed [s], one after the other.

    Args:
        ask: what the sweep says of it.
        planned: the runs.
        per_step: what a step takes [s].
    """
    if ask is None:
        return 0.0
    runs = [min(max(each.steps * per_step, LEAST), MOST) for _, each in planned]
    return ask.rounds * (sum(runs) + len(runs) * SINGLE)


def _steps(family: list[ResolvedRun], refine: int) -> float:
    finest = max(run.duration / run.timestep for run in family)
    # The coarser march of the reference, its twin, and the finer one with twice as many steps.
    reference = 4 * refine * finest * _EVALUATIONS
    return reference + sum(run.steps for run in family)
