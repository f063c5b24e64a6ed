"""Where friction throws a ball that is hit off centre."""

import numpy as np

from contactlab.contact import NORMAL, Floats, damping_ratio, restitution_of
from contactlab.measure.context import Context
from contactlab.measure.oracles.oracle import Oracle, setting

_INERTIA = 2 / 7
"""What a hit at a solid ball's surface has to overcome sideways, as a share: 1 / (1 + 5 / 2)."""


def _throw(context: Context) -> tuple[Floats, Floats]:
    friction = setting(context, "friction")[:, 0]
    kept = restitution_of(damping_ratio(setting(context, "solref")))
    stick = _INERTIA * np.tan(np.radians(setting(context, "cut"))) / (1 + kept)
    pair, target = context.trace.pairs[0], context.setup.free_bodies[1]
    first = pair.touching[:, :, 0].argmax(axis=1)
    line = pair.slots[np.arange(len(first)), first, 0, NORMAL]
    thrown = context.trace.qvel[:, -1, target.dof : target.dof + 3]
    along = np.abs((thrown * line).sum(axis=1))
    across = np.linalg.norm(np.cross(thrown, line), axis=1)
    return np.minimum(friction, stick), across / along


THROW = Oracle(
    name="throw",
    unit="1",
    relative=False,
    definition=(
        "Tangent of the angle between the line of centres and the velocity that a ball at rest is "
        "given: mu while two equal solid balls slide on each other, and 2/7 tan(cut) / (1 + e) if "
        "friction stops that, whichever is less (Coulomb's law for impulses). Measured: velocity "
        "of the second free body in the last state, line of centres at first touch."
    ),
    settings=("friction", "solref", "cut"),
    function=_throw,
)
