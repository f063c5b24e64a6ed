"""Restitution of two free bodies that collide."""

import numpy as np

from contactlab.contact import Floats, damping_ratio, restitution_of
from contactlab.measure.context import Context
from contactlab.measure.oracles.oracle import Oracle, setting


def _pair_restitution(context: Context) -> tuple[Floats, Floats]:
    approach, parting = (_closing(context, state) for state in (0, -1))
    square = (approach**2).sum(axis=1)
    measured = -(approach * parting).sum(axis=1) / square
    return restitution_of(damping_ratio(setting(context, "solref"))), measured


def _closing(context: Context, state: int) -> Floats:
    """Return (n, 3) velocity [m/s] of the first free body relative to the second."""
    first, second = (
        context.trace.qvel[:, state, body.dof : body.dof + 3]
        for body in context.setup.free_bodies[:2]
    )
    return np.asarray(first - second)


PAIR_RESTITUTION = Oracle(
    name="pair_restitution",
    unit="1",
    relative=False,
    definition=(
        "e = exp(-2 zeta acos(zeta) / sqrt(1 - zeta^2)), zeta the damping ratio of solref, for "
        "bodies of any mass, since solref is a rate and not a stiffness. Measured: relative "
        "velocity of the first two free bodies in the last state along that in the first, over "
        "it, which must lie on the line of centres."
    ),
    settings=("solref",),
    function=_pair_restitution,
)
