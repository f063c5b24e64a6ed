"""How deep an impact goes before the contact turns it round."""

import numpy as np

from contactlab.contact import Floats, damping_ratio, restitution_of, stiffness_damping
from contactlab.measure.context import Context, contact_depths
from contactlab.measure.oracles.oracle import Oracle, setting


def _impact_depth(context: Context) -> tuple[Floats, Floats]:
    solref, speed = setting(context, "solref"), setting(context, "speed")
    rate = np.sqrt(stiffness_damping(solref)[0])
    depth = speed / rate * np.sqrt(restitution_of(damping_ratio(solref)))
    if context.setup.speculative is not None:
        depth = np.where(context.setup.speculative, np.nan, depth)
    deepest = np.fmax.reduce([each.max(axis=1) for _, each in contact_depths(context)])
    travel = speed * context.trace.timestep
    return depth / travel, deepest / travel


IMPACT_DEPTH = Oracle(
    name="impact_depth",
    unit="1",
    relative=False,
    definition=(
        "An oscillator of rate w and damping ratio zeta that is hit at speed v turns round at "
        "(v / w) exp(-zeta acos(zeta) / sqrt(1 - zeta^2)), which is 0.368 v tc at critical "
        "damping. Holds for impacts that are fast beside g / w. Not defined for speculative "
        "contacts. Measured: the largest depth of any graded pair. Both are in units of the way "
        "that the body goes in a step."
    ),
    settings=("solref", "speed"),
    function=_impact_depth,
)
