"""The floors: what rounding, and where the solver starts, make of MuJoCo itself."""

import copy
from dataclasses import replace

import mujoco
import numpy as np

from contactlab.engines.engine import PreparedRuns
from contactlab.scene.model_names import PARTS

_WARMSTART = int(mujoco.mjtDisableBit.mjDSBL_WARMSTART)


def rounded(runs: PreparedRuns) -> PreparedRuns:
    """Return runs that start from states, and with inputs, rounded to single precision."""
    arrays = {name: getattr(runs.starts, name) for name in PARTS}
    single = {name: each.astype(np.float32).astype(np.float64) for name, each in arrays.items()}
    return replace(runs, starts=runs.starts._replace(**single))


def cold(runs: PreparedRuns) -> PreparedRuns:
    """Return runs in which the solver starts from nothing in each step.

    It ends elsewhere within its tolerance, as that of another engine does.
    """
    models = [copy.copy(model) for model in runs.models]
    for model in models:
        model.opt.disableflags |= _WARMSTART
    pairs = zip(runs.prepared, models, strict=True)
    return replace(runs, prepared=[replace(each, model=model) for each, model in pairs])
