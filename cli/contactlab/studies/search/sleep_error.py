"""Errors of models whose bodies may sleep; only whole runs show the effect of sleep."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from contactlab.budget import Motion, Settings, error_budget
from contactlab.budget.restarts import motion_at_steps, run_at_once
from contactlab.studies.search.settings_search import ErrorEstimator
from contactlab.tasks.reference_error import ErrorEstimate

_SLEEP = int(getattr(mujoco.mjtEnableBit, "mjENBL_SLEEP", 0))


@dataclass(frozen=True)
class SleepAwareError:
    """Estimates errors by windows, in which all bodies begin awake, and by whole runs with sleep.

    Attributes:
        awake: the estimator by windows.
        motions: phases of the task.
        substeps: fine steps in a timestep of the model as written.
        workers: threads.
    """

    awake: ErrorEstimator
    motions: Sequence[Motion]
    substeps: int
    workers: int

    def estimate_error(self, model: mujoco.MjModel, multiple: int) -> ErrorEstimate:
        """Return the larger of the error awake, and of the error of whole runs with sleep."""
        if not int(model.opt.enableflags) & _SLEEP:
            return self.awake.estimate_error(model, multiple)
        awake = copy.copy(model)
        awake.opt.enableflags &= ~_SLEEP
        awake_error = self.awake.estimate_error(awake, multiple)
        sleeping_model = run_at_once(model)
        sleeping_model.opt.timestep = multiple * self.motions[0].model.opt.timestep / self.substeps
        runs = [
            replace(
                motion_at_steps(motion, self.substeps, np.arange(motion.seeds), multiple),
                model=sleeping_model,
            )
            for motion in self.motions
        ]
        settings = Settings(places=False, excess=False, workers=self.workers)
        budget = error_budget(runs, rows=(), settings=settings)
        asleep = ErrorEstimate.of_budget(budget)
        return awake_error if asleep.error <= awake_error.error else asleep
