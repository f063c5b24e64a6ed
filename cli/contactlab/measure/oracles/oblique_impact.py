"""How a point mass leaves an impact with friction."""

import numpy as np

from contactlab.contact import Floats, damping_ratio, restitution_of
from contactlab.measure.context import Context
from contactlab.measure.oracles.motion import sliding_friction
from contactlab.measure.oracles.oracle import Oracle, setting


def _oblique_impact(context: Context) -> tuple[Floats, Floats]:
    before, after = context.trace.qvel[:, 0, :3], context.trace.qvel[:, -1, :3]
    off = np.linalg.norm(after - _rebound(context, before), axis=1)
    return np.zeros(context.trace.runs), off / np.linalg.norm(before, axis=1)


def _rebound(context: Context, before: Floats) -> Floats:
    """Return (n, 3) the velocity [m/s] after the impact on a floor whose normal is z."""
    restitution = restitution_of(damping_ratio(setting(context, "solref")))
    push = -(1 + restitution) * before[:, 2]
    tangential = np.linalg.norm(before[:, :2], axis=1)
    lost = np.minimum(sliding_friction(context) * push, tangential)
    kept = 1 - lost / np.where(tangential > 0, tangential, 1)
    return np.column_stack([before[:, :2] * kept[:, None], before[:, 2] + push])


OBLIQUE_IMPACT = Oracle(
    name="oblique_impact",
    unit="1",
    relative=False,
    definition=(
        "A point mass that meets a floor at velocity (v_t, -v_n) gets the impulses "
        "J_n = (1 + e) m v_n and J_t = min(mu J_n, m v_t) against v_t, with e from the damping "
        "ratio of solref (Newton's restitution, Coulomb's friction). Measured: distance of the "
        "last velocity from that of the law, over the speed at the start. The first three degrees "
        "of freedom are slides along x, y and the normal z; there is no gravity."
    ),
    settings=("solref", "friction"),
    function=_oblique_impact,
)
