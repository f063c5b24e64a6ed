"""Counts the time of simulations from their work, which load and machines do not change.

Limits in counted time end a search before the same trial everywhere, and ranks by counted cost are
the same everywhere. Simulated steps are counted in this process, whichever model makes them, and
cost as much as those of the examined one.
"""

import math
import time
import weakref
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np

from contactlab.budget.measuring import WINDOW, Settings, count_evaluations, steps_of
from contactlab.budget.motion import INTEGRATION, Motion
from contactlab.budget.step_work import UNIT_SECONDS, StepWork
from contactlab.budget.windows import (
    count_simulated_steps,
    count_stages,
    replay_motion,
    without_sensors,
)
from contactlab.contact.trace_arrays import Floats
from contactlab.modifications.catalogue import list_rows

_CPU_SLACK = 3.0
"""A search ends in any case above this ratio of CPU time over counted time.

A busy machine doubles CPU time, and counted time is right to a factor of 1.5."""


@dataclass(frozen=True)
class WorkLimit:
    """A limit of counted time, from the moment that it is made. CPU time only ends it.

    Attributes:
        seconds: its length [s].
    """

    seconds: float
    _steps: float = field(default_factory=count_simulated_steps)
    _cpu: float = field(default_factory=time.process_time)

    def find_remainder(self, share: float, motions: Sequence[Motion]) -> float:
        """Return the counted time until a share of the limit [s]; negative after it.

        The motions are those of the examined model. A step counts as one of it.
        """
        steps = (count_simulated_steps() - self._steps) / count_stages(motions[0].model)
        counted = steps * count_pace(motions)
        late = time.process_time() - self._cpu > _CPU_SLACK * share * self.seconds
        return -1.0 if late else share * self.seconds - counted


def count_pace(motions: Sequence[Motion]) -> float:
    """Return the counted time of a step of the model [s], in the shortest of its motions."""
    shortest = min(motions, key=lambda motion: motion.steps)
    key = id(shortest.model), id(shortest.inputs)
    known = _PACES.get(key)
    if known is not None and known[0]() is shortest.inputs:
        return known[1]
    one = replace(shortest, starts=shortest.starts[:1], inputs=shortest.inputs[:1])
    # Some states are evaluated, in Python: measured for five robots.
    python_seconds = 3e-6
    seconds = count_step_seconds(one, one.model, sample_states(one)) + python_seconds
    _PACES[key] = weakref.ref(shortest.inputs), seconds
    return seconds


_PACES = dict[tuple[int, int], tuple[weakref.ref[Floats], float]]()
"""Counted time of a step [s] by the ids of a motion's model and inputs, while these exist."""


def plan_budget(
    motions: Sequence[Motion], settings: Settings, seconds: float
) -> tuple[tuple[str, ...], Settings]:
    """Return the rows and the settings of a budget that takes at most this counted time [s].

    Rows that judge nothing are left out first. If the others would take twice that time, only the
    run is measured, and, if that does too, by a first look.
    """
    rows = [row for row in list_rows() if any(row.applies(motion.model) for motion in motions)]
    judging = [row for row in rows if row.kind in ("numerics", "model")]
    quick = replace(settings, check=False, energy=False)
    steps = 1.0 if math.isinf(seconds) else steps_of(motions) * count_pace(motions)
    ladder = [(rows, settings, 1), (judging, settings, 2), ([], settings, 2)]
    few, measured = next(
        (
            (few, measured)
            for few, measured, times in ladder
            if count_evaluations(motions[0].model, measured, few) * steps <= times * seconds
        ),
        ([], quick),
    )
    return tuple(row.name for row in few), measured


def sample_states(motion: Motion) -> list[tuple[int, Floats]]:
    """Return steps and states of the first seed of a motion, evenly spread over it."""
    run = replay_motion(motion, WINDOW, 1)
    windows = np.flatnonzero(run.valid[0] & np.isfinite(run.starts[0]).all(axis=1))
    if not len(windows):
        return [(0, motion.starts[0])]
    samples = 6
    chosen = windows[np.unique(np.linspace(0, len(windows) - 1, samples).astype(int))]
    return [(int(run.begins[window]), run.starts[0, window]) for window in chosen]


def count_step_seconds(
    motion: Motion, model: mujoco.MjModel, states: Sequence[tuple[int, Floats]]
) -> float:
    """Return the counted time of a step of a model from states of a motion [s].

    The model has the same states as that of the motion; its step may be shorter.
    """
    bare_model = without_sensors(model)
    data, work = mujoco.MjData(bare_model), StepWork(bare_model)
    for begin, state in states:
        mujoco.mj_resetData(bare_model, data)  # wakes sleeping bodies
        mujoco.mj_setState(bare_model, data, state, INTEGRATION)
        try:
            steps = 3  # the first is not counted
            work.count_steps(data, steps, motion.rows(0, begin + np.arange(steps)), motion.spec)
        except mujoco.FatalError:
            continue
    return float(work.total @ UNIT_SECONDS) / max(work.steps, 1)
