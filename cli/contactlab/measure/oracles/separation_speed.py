"""How fast two overlapping bodies are thrown apart."""

import numpy as np

from contactlab.contact import Floats, damping_ratio, restitution_of, stiffness_damping
from contactlab.measure.context import Context
from contactlab.measure.oracles.oracle import Oracle, setting


def _separation_speed(context: Context) -> tuple[Floats, Floats]:
    solref = setting(context, "solref")
    stiffness, _ = stiffness_damping(solref)
    shared = _sharing(context.trace.pairs[0].found[:, 0], setting(context, "solimp")[:, 1])
    kept = np.sqrt(restitution_of(damping_ratio(solref) * np.sqrt(shared)))
    speed = np.sqrt(stiffness * shared) * setting(context, "overlap") * kept
    first, second = (
        context.trace.qvel[:, -1, body.dof : body.dof + 3] for body in context.setup.free_bodies[:2]
    )
    return speed, np.linalg.norm(second - first, axis=1)


def _sharing(contacts: Floats, impedance: Floats) -> Floats:
    """Return how much stiffer and more damped N parallel contacts are than one.

    Each is regularised for itself, so that together they reach the impedance d N / (1 + (N - 1) d).
    """
    return contacts / (1 + (contacts - 1) * impedance)


SEPARATION_SPEED = Oracle(
    name="separation_speed",
    unit="m/s",
    relative=True,
    definition=(
        "v = w r exp(-zeta acos(zeta) / sqrt(1 - zeta^2)) for two free bodies that overlap by r at "
        "rest: the contact's oscillator until its force ends, with rate w and damping ratio zeta; "
        "K and B of N equal contacts are N / (1 + (N - 1) d) times one's. Holds for constant "
        "impedance d without friction or gravity. Measured: relative speed of the first two free "
        "bodies in the last state."
    ),
    settings=("solref", "solimp", "overlap"),
    function=_separation_speed,
)
