"""The cost of changed models, as counted work over that of the model as written.

A count is the same on any machine, under any load, and in the first of many runs. It decides the
trials and the recommendation of a search. Measured times are reported, and reject a candidate that
is slower than its count.
"""

import copy
import math
from collections.abc import Sequence

import mujoco
import numpy as np

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION, without_delays
from contactlab.budget.step_work import UNIT_SECONDS, StepWork
from contactlab.budget.windows import Run, replay_motion
from contactlab.contact.trace_arrays import Floats
from contactlab.scene.model_edits import read_flag, set_timestep

SAMPLE_SECONDS = 0.04
"""s between the states where steps are counted, and length of these steps, if they are few."""
_AUTORESET_OFF = int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)


class CountedCost:
    """Counts the work of models from states of the task that the model as written reaches.

    Attributes:
        pass_seconds: counted time of the task for one seed of the model as written [s].
        step_seconds: counted time of one of its steps [s].
        sample_seconds: counted time of one sample of a phase [s].
    """

    def __init__(
        self,
        motions: Sequence[Motion],
        base: mujoco.MjModel,
        workers: int,
        samples: int = 12,
    ) -> None:
        """Run the motions once, and count the model as written, compiled from its files.

        `samples` is the number of states of each phase, from 3 to 12: contacts come and go, and
        fewer would miss some of them.
        """
        self._motions = [without_delays(motion) for motion in motions]
        samples = min(12, max(3, samples))
        self._starts = [
            _sample_states(replay_motion(motion, SAMPLE_SECONDS, workers), samples)
            for motion in motions
        ]
        self._own_step = float(motions[0].model.opt.timestep)
        self.fine_step = self._own_step
        length = sum(motion.steps for motion in motions) * self._own_step
        self._base_seconds = self.count_seconds(base, self._own_step)
        self.pass_seconds = length * self._base_seconds
        self.step_seconds = self._own_step * self._base_seconds
        self.sample_seconds = _steps_of_sample(self._own_step) * self.step_seconds

    def count_cost(self, model: mujoco.MjModel, multiple: int) -> float:
        """Return the counted work per simulated second, over that of the model as written.

        The timestep is `multiple` fine steps.
        """
        return self.count_seconds(model, multiple * self.fine_step) / self._base_seconds

    def count_seconds(self, model: mujoco.MjModel, timestep: float) -> float:
        """Return the counted time per simulated second of a model at a timestep [s]."""
        stepped_model = copy.copy(model)
        set_timestep(stepped_model, timestep)
        stepped_model.opt.disableflags &= ~_AUTORESET_OFF  # as in files; recording never resets
        data, work = mujoco.MjData(stepped_model), StepWork(stepped_model)
        steps = _steps_of_sample(timestep)
        if read_flag(stepped_model, "sleep"):
            steps = 40  # bodies fall asleep after ten steps of rest
        for motion, samples in zip(self._motions, self._starts, strict=True):
            for seed, begin, start in samples:
                mujoco.mj_resetData(stepped_model, data)  # wakes sleeping bodies
                mujoco.mj_setState(stepped_model, data, start, INTEGRATION)
                at = begin + np.arange(steps) * timestep / self._own_step
                rows = motion.rows(seed, np.floor(at + 1e-9).astype(int))
                try:
                    work.count_steps(data, steps, rows, motion.spec)
                except mujoco.FatalError:
                    return math.inf
        per_step = float(work.total @ UNIT_SECONDS) / max(work.steps, 1)
        return per_step / timestep


def _steps_of_sample(timestep: float) -> int:
    # The first step, which begins without a warm start, is not counted; the work of later ones
    # hardly differs.
    least, most = 3, 8
    return min(most, max(least, round(SAMPLE_SECONDS / timestep)))


def _sample_states(run: Run, samples: int) -> list[tuple[int, int, Floats]]:
    seeds, windows = np.nonzero(run.valid & np.isfinite(run.starts).all(axis=2))
    if not len(seeds):
        return [(0, 0, run.starts[0, 0])]
    order = np.lexsort((seeds, windows))
    chosen = order[np.unique(np.linspace(0, len(order) - 1, samples).astype(int))]
    return [
        (int(seeds[row]), int(run.begins[windows[row]]), run.starts[seeds[row], windows[row]])
        for row in chosen
    ]
