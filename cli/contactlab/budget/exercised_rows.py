"""Finds the rows of a budget that a task exercises."""

from collections.abc import Sequence

import mujoco
import numpy as np

from contactlab.budget.motion import INTEGRATION, Motion
from contactlab.budget.windows import without_sensors
from contactlab.modifications.modification import Row


def exercised_rows(motion: Motion, rows: Sequence[Row]) -> set[str]:
    """Return the names of rows that a state of the run exercises.

    All steps of all seeds are searched until each row is found once.
    """
    pending, loaded = list(rows), set[str]()
    if not pending:
        return loaded
    model = without_sensors(motion.model)
    data = mujoco.MjData(model)
    for seed in range(motion.seeds):
        mujoco.mj_setState(model, data, motion.starts[seed], INTEGRATION)
        inputs = motion.rows(seed, np.arange(motion.steps))
        for step in range(motion.steps):
            if not pending:
                return loaded
            if inputs is not None:
                mujoco.mj_setState(model, data, inputs[step], motion.spec)
            mujoco.mj_step(model, data)
            loaded |= {row.name for row in pending if row.is_loaded(model, data)}
            pending = [row for row in pending if row.name not in loaded]
    return loaded
