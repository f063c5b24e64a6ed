"""Metrics of how far joints move and bodies turn, there and back."""

import numpy as np

from contactlab.contact import Floats
from contactlab.measure.context import Context
from contactlab.measure.metric import Metric


def _joint_travel(context: Context) -> Floats:
    free = {body.dof + place for body in context.setup.free_bodies for place in range(6)}
    jointed = [place for place in range(context.trace.qvel.shape[2]) if place not in free]
    if not jointed:
        return context.nothing()
    speeds = np.abs(context.trace.qvel[:, 1:][:, :, jointed])
    return speeds.sum(axis=1).max(axis=1) * context.trace.timestep


def _turn(context: Context) -> Floats:
    bodies = context.setup.free_bodies
    if not bodies:
        return context.nothing()
    spins = [context.trace.qvel[:, 1:, body.dof + 3 : body.dof + 6] for body in bodies]
    angles = [np.sqrt((spin * spin).sum(axis=2)).sum(axis=1) for spin in spins]
    return np.maximum.reduce(angles) * context.trace.timestep


TRAVEL = (
    Metric(
        "joint_travel",
        "any",
        "none",
        1e-9,
        1,
        "Speed summed over time of the degree of freedom that moves most, of all that belong to "
        "no free body: m for slides, rad for hinges and ball joints.",
        _joint_travel,
    ),
    Metric(
        "turn",
        "rad",
        "none",
        1e-9,
        1,
        "Angular speed summed over time of the free body that turns most.",
        _turn,
    ),
)
