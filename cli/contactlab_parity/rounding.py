"""The floor: what rounding to single precision makes of MuJoCo itself."""

from dataclasses import replace

import numpy as np

from contactlab.engines.engine import PreparedRuns
from contactlab.scene.model_names import PARTS


def rounded(runs: PreparedRuns) -> PreparedRuns:
    """Return runs that start from states, and with inputs, rounded to single precision."""
    arrays = {name: getattr(runs.starts, name) for name in PARTS}
    single = {name: each.astype(np.float32).astype(np.float64) for name, each in arrays.items()}
    return replace(runs, starts=runs.starts._replace(**single))
