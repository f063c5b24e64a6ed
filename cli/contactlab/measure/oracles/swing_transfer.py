"""How high the last pendulum of a cradle swings."""

import numpy as np

from contactlab.contact import Floats
from contactlab.measure.context import Context
from contactlab.measure.oracles.oracle import Oracle, setting


def _swing_transfer(context: Context) -> tuple[Floats, Floats]:
    swing = -context.trace.qpos[:, :, -1]
    out = swing > swing[:, :1] + np.radians(1)
    out[:, -1] = False
    rising = np.diff(swing, axis=1) > 0
    first = out.argmax(axis=1)
    after = np.arange(rising.shape[1]) >= first[:, None]
    peak = (after & ~rising).argmax(axis=1)
    highest = swing[np.arange(len(swing)), peak]
    return setting(context, "angle"), np.degrees(np.where(out.any(axis=1), highest, np.nan))


SWING_TRANSFER = Oracle(
    name="swing_transfer",
    unit="deg",
    relative=False,
    definition=(
        "Equal balls hit one after the other hand on all of their momentum and energy, so that "
        "the last pendulum swings out as far as the first came in. Measured: the last hinge's "
        "angle where it first comes to rest after it has left by over a degree."
    ),
    settings=("angle",),
    function=_swing_transfer,
)
