"""Whether a ladder on a rough floor stands against a smooth wall."""

import numpy as np

from contactlab.contact import Floats
from contactlab.measure.context import Context
from contactlab.measure.oracles.motion import sliding_friction
from contactlab.measure.oracles.oracle import Oracle, setting

_LENGTH = 1.0
_LEAN = 2
_FALLEN = np.radians(5)


def _ladder(context: Context) -> tuple[Floats, Floats]:
    angle, radius = np.radians(setting(context, "angle")), context.setup.thickness[0]
    grip = 2 * sliding_friction(context) * (1 + radius / (_LENGTH * np.cos(angle)))
    lean = context.trace.qpos[:, :, _LEAN]
    gained = (lean[:, -1] - lean[:, 0]) / _FALLEN
    return np.where(np.tan(angle) > grip, 1.0, 0.0), np.minimum(gained, 1)


LADDER = Oracle(
    name="ladder",
    unit="1",
    relative=False,
    definition=(
        "A uniform ladder whose axis has the length L = 1 m, rounded with radius r at both ends, "
        "stands against a smooth wall while tan(angle) <= 2 mu (1 + r / (L cos(angle))), the angle "
        "from the vertical: 0 if so, 1 if it falls (moments about the foot; the wall bears "
        "mu m g at most). Measured: the angle gained over 5 degrees, at most 1. The hinge is the "
        "third degree of freedom."
    ),
    settings=("angle", "friction"),
    function=_ladder,
)
