"""The task that a model is judged on, and the seeds and settings of its numerical error.

Every study that says how accurate a model is settles its task here, so that all print one number.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from contactlab.budget.counted_time import count_pace
from contactlab.budget.measuring import steps_of
from contactlab.plan.task_options import TaskOptions
from contactlab.studies.examine.engine_faults import MetFaults, find_met_faults
from contactlab.tasks.checked_model import CheckedModel, open_model

MAX_CPU = 60.0
"""CPU time of an examination at most, its page included [s]."""
BUDGETING = 0.4
"""Share of it; later, no more rows that judge nothing are begun."""


class JudgedModel(NamedTuple):
    """A model with the task that it is judged on.

    Attributes:
        examined: the model.
        task: replacements for parts of its own task, with those that there is time for.
        met: known faults of the engine.
        left_out: parts of the task that there is no time for.
    """

    examined: CheckedModel
    task: TaskOptions
    met: MetFaults = MetFaults()
    left_out: tuple[str, ...] = ()


def settle_task(
    examined: CheckedModel,
    reopen: Callable[[TaskOptions], CheckedModel],
    *,
    max_cpu: float = MAX_CPU,
    finds_faults: bool = True,
    avoids_faults: bool = True,
) -> JudgedModel:
    """Shorten the task of a heavy model, and add seeds while they disagree about the tolerance.

    Args:
        examined: the model, which moves.
        reopen: opens it with another task.
        max_cpu: counted time of an examination [s].
        finds_faults: whether known faults of the engine are looked for.
        avoids_faults: whether a model that meets one is judged by its forces without the fault.
    """
    task, left_out = _shorten_heavy_task(examined, max_cpu)
    if left_out:
        examined = reopen(task)
    met = MetFaults()
    if finds_faults:
        met = find_met_faults(examined.motions, list_begins(examined), examined.scene.source)
    if met.acts and avoids_faults:
        settings = replace(examined.settings, check=False, energy=False)
        examined.rows, examined.settings = (), settings
    examined.add_seeds()
    return JudgedModel(examined, task, met, left_out)


def judge_as_examined(examined: CheckedModel) -> CheckedModel:
    """Return a model with the numerical error that `contactlab MODEL` prints, and no rows."""
    seconds = BUDGETING * MAX_CPU

    def open_with_task(task: TaskOptions) -> CheckedModel:
        return open_model(examined.reference, examined.session, task, rows=(), seconds=seconds)

    return settle_task(replace(examined, rows=(), seconds=seconds), open_with_task).examined


def list_begins(examined: CheckedModel) -> list[float]:
    """Return when the phases begin that motions have [s]."""
    begins = {phase.name: phase.begin for phase in examined.task.phases}
    return [begins.get(motion.name, 0.0) for motion in examined.motions]


def _shorten_heavy_task(
    examined: CheckedModel, max_cpu: float
) -> tuple[TaskOptions, tuple[str, ...]]:
    # Return a task that there is counted time for, and the parts of the whole one that it lacks:
    # first seeds, then time. A requested number of seeds or duration is kept.
    task, whole, left_out = examined.options, examined.task, list[str]()
    passes = 30  # over the task: its runs, checks, facts, and the shortest budget
    motions, most = examined.motions, max_cpu / passes
    counted = steps_of(motions) * count_pace(motions)
    if counted < most:
        return task, ()
    share = most / counted
    if task.seeds is None and share < 1:
        seeds = max(1, int(share * len(whole.seeds)))
        share *= len(whole.seeds) / seeds
        task = replace(task, seeds=seeds)
        left_out.append(f"{len(whole.seeds) - seeds} more seeds")
    if task.duration is None and share < 1:
        seconds = share * whole.duration
        digits = 1 - math.floor(math.log10(seconds))
        seconds = math.floor(seconds * 10**digits) / 10**digits  # two digits, rounded down
        task = replace(task, duration=seconds)
        left_out.append(f"more than {seconds:g} s of {whole.duration:g} s")
    return task, tuple(left_out)
