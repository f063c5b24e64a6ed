"""Restitution from the damping ratio."""

from contactlab.contact import Floats, damping_ratio, restitution_of
from contactlab.measure.context import Context
from contactlab.measure.oracles.oracle import Oracle, setting
from contactlab.measure.restitution import restitution


def _restitution(context: Context) -> tuple[Floats, Floats]:
    return restitution_of(damping_ratio(setting(context, "solref"))), restitution(context)


RESTITUTION_LAW = Oracle(
    name="restitution",
    unit="1",
    relative=False,
    definition=(
        "e = exp(-2 zeta acos(zeta) / sqrt(1 - zeta^2)), zeta the damping ratio of solref: the "
        "oscillator of MuJoCo's contact with constant impedance, whose force only pushes. Holds "
        "for impacts that are fast beside g / w and for w timestep <= 0.1, w the contact's rate. "
        "Measured: the metric restitution_measured."
    ),
    settings=("solref",),
    function=_restitution,
)
