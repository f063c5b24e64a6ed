"""Errors of models whose bodies may sleep: what sleep does shows in whole runs alone."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from contactlab.budget import Motion, Settings, error_budget
from contactlab.budget.measuring import run_at_once
from contactlab.studies.search.searching import Measure
from contactlab.studies.search.yardstick import Apart, at_steps

_SLEEP = int(getattr(mujoco.mjtEnableBit, "mjENBL_SLEEP", 0))


@dataclass(frozen=True)
class OrAsleep:
    """A measure by windows, in which all bodies begin awake; of whole runs where they may sleep.

    Attributes:
        awake: the measure by windows.
        motions: phases of the task.
        finer: fine steps in one of the model as written.
        workers: threads.
    """

    awake: Measure
    motions: Sequence[Motion]
    finer: int
    workers: int

    def apart(self, model: mujoco.MjModel, multiple: int) -> Apart:
        """Return how far the model is awake, or its own whole runs are, if that is more."""
        if not int(model.opt.enableflags) & _SLEEP:
            return self.awake.apart(model, multiple)
        awake = copy.copy(model)
        awake.opt.enableflags &= ~_SLEEP
        found = self.awake.apart(awake, multiple)
        made = run_at_once(model)
        made.opt.timestep = multiple * self.motions[0].model.opt.timestep / self.finer
        runs = [
            replace(at_steps(motion, self.finer, np.arange(motion.seeds), multiple), model=made)
            for motion in self.motions
        ]
        settings = Settings(places=False, excess=False, workers=self.workers)
        budget = error_budget(runs, rows=(), settings=settings)
        phase = max(budget.phases, key=lambda phase: phase.run.share)
        run = phase.run
        if run.share <= found.share:
            return found
        low, high = float(run.seeds.min()), float(run.seeds.max())
        return Apart(run.share, phase.bodies[run.body], phase.name, run.time, low, high)
