"""How high a body hovers: a metric, a label and an oracle."""

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.measure import (
    Context,
    MeasuredRuns,
    Onset,
    Onsets,
    Threshold,
    label,
    metric,
    oracle,
)


@metric(unit="m", better="lower", resolution=1e-9)
def hover_height(context: Context) -> Floats:
    """Largest height that the first body gains over its start."""
    height = context.trace.qpos[:, :, 2]
    return (height - height[:, :1]).max(axis=1)


@label("noted", thresholds=(Threshold("hover", -1.0, "m", "Largest height gained; a test's."),))
def hovering(runs: MeasuredRuns) -> Onsets:
    """The first body gains more height than accepted."""
    high = np.flatnonzero(runs.metrics["hover_height"] > runs.limits["hover"])
    return {int(run): Onset("it hovers", 0) for run in high}


@oracle(unit="m", settings=("drop_height",), relative=False)
def starting_height(context: Context) -> tuple[Floats, Floats]:
    """A body starts at the height that it is dropped from."""
    start = context.trace.qpos[:, 0, 2]
    return start, start
