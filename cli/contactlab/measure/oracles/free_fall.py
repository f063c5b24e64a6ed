"""Where a body flies under gravity alone."""

import numpy as np

from contactlab.contact import Floats
from contactlab.measure.context import Context
from contactlab.measure.oracles.motion import pulled
from contactlab.measure.oracles.oracle import Oracle


def _free_fall(context: Context) -> tuple[Floats, Floats]:
    trace, body = context.trace, context.setup.free_bodies[0]
    steps = np.arange(trace.steps + 1)
    place = trace.qpos[:, :, body.qpos : body.qpos + 3]
    velocity = trace.qvel[:, :1, body.dof : body.dof + 3]
    drifted = velocity * (trace.timestep[:, None] * steps)[:, :, None]
    fallen = context.setup.gravity[:, None] * pulled(context, steps)[:, :, None]
    off = np.linalg.norm(place - place[:, :1] - drifted - fallen, axis=2)
    return np.zeros(trace.runs), off.max(axis=1)


FREE_FALL = Oracle(
    name="free_fall",
    unit="m",
    relative=False,
    definition=(
        "After N steps of length h a body without contact is at x0 + v0 h N + g h^2 N (N + 1) / 2 "
        "by semi-implicit integrators, and at x0 + v0 h N + g (h N)^2 / 2 by RK4: both sums are "
        "exact. Measured: the largest distance of the first free body from there at any step."
    ),
    settings=("integrator",),
    function=_free_fall,
)
