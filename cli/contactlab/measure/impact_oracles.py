"""Closed forms of impacts: restitution, depth, friction and the transfer of momentum."""

import numpy as np

from contactlab.contact.contact_laws import damping_ratio, restitution_of, stiffness_damping
from contactlab.contact.trace_arrays import NORMAL, Floats
from contactlab.measure.context import Context, contact_depths
from contactlab.measure.entries import oracle
from contactlab.measure.oracle_error import end_velocity, friction, restitution_of_solref
from contactlab.measure.restitution import restitution_measured

_BALL = 2 / 7
"""What a hit at a solid ball's surface has to overcome sideways, as a share: 1 / (1 + 5 / 2)."""


@oracle(unit="1", settings=("solref",), relative=False)
def restitution(context: Context) -> tuple[Floats, Floats]:
    """Restitution e = exp(-2 zeta acos(zeta) / sqrt(1 - zeta^2)), zeta the damping ratio of solref.

    The oscillator of MuJoCo's contact with constant impedance, whose force only pushes. Holds for
    impacts that are fast beside g / w and for w timestep <= 0.1, w the contact's rate. Measured:
    the metric restitution_measured.
    """
    return restitution_of_solref(context), restitution_measured(context)


@oracle(unit="1", settings=("solref",), relative=False)
def pair_restitution(context: Context) -> tuple[Floats, Floats]:
    """Restitution of two free bodies, e = exp(-2 zeta acos(zeta) / sqrt(1 - zeta^2)).

    zeta is the damping ratio of solref; for bodies of any mass, since solref is a rate and not a
    stiffness. Measured: relative velocity of the first two free bodies in the last state along
    that in the first, over it, which must lie on the line of centres.
    """
    approach, parting = (
        end_velocity(context, 0, state) - end_velocity(context, 1, state) for state in (0, -1)
    )
    square = (approach**2).sum(axis=1)
    return restitution_of_solref(context), -(approach * parting).sum(axis=1) / square


@oracle(unit="1", settings=("solref", "speed"), relative=False)
def impact_depth(context: Context) -> tuple[Floats, Floats]:
    """Depth of an impact, (v / w) exp(-zeta acos(zeta) / sqrt(1 - zeta^2)).

    That is where an oscillator of rate w and damping ratio zeta that is hit at speed v turns
    back: 0.368 v tc at critical damping. Holds for impacts that are fast beside g / w. Not
    defined for speculative contacts. Measured: the largest penetration of any monitored pair. Both
    are in units of the distance that the body moves in one step.
    """
    solref, speed = context.setting("solref"), context.setting("speed")
    rate = np.sqrt(stiffness_damping(solref)[0])
    depth = speed / rate * np.sqrt(restitution_of(damping_ratio(solref)))
    if context.setup.speculative is not None:
        depth = np.where(context.setup.speculative, np.nan, depth)
    deepest = np.fmax.reduce([each.max(axis=1) for _, each in contact_depths(context)])
    travel = speed * context.trace.timestep
    return depth / travel, deepest / travel


@oracle(unit="m/s", settings=("solref", "solimp", "overlap"), relative=True)
def separation_speed(context: Context) -> tuple[Floats, Floats]:
    """Speed v = w r exp(-zeta acos(zeta) / sqrt(1 - zeta^2)) at which overlapping bodies part.

    Two free bodies overlap by r at rest: the contact's oscillator until its force ends, with rate
    w and damping ratio zeta; K and B of N equal contacts are N / (1 + (N - 1) d) times one's.
    Holds for constant impedance d without friction or gravity. Measured: relative speed of the
    first two free bodies in the last state.
    """
    solref = context.setting("solref")
    stiffness, _ = stiffness_damping(solref)
    # Each of N contacts is regularised for itself: together they reach d N / (1 + (N - 1) d).
    contacts, impedance = context.trace.pairs[0].found[:, 0], context.setting("solimp")[:, 1]
    shared = contacts / (1 + (contacts - 1) * impedance)
    kept = np.sqrt(restitution_of(damping_ratio(solref) * np.sqrt(shared)))
    speed = np.sqrt(stiffness * shared) * context.setting("overlap") * kept
    return speed, np.linalg.norm(end_velocity(context, 1) - end_velocity(context, 0), axis=1)


@oracle(unit="1", settings=("solref", "friction"), relative=False)
def oblique_impact(context: Context) -> tuple[Floats, Floats]:
    """Velocity of a point mass after an impact with friction (Newton, Coulomb).

    A point mass that meets a floor at velocity (v_t, -v_n) gets the impulses J_n = (1 + e) m v_n
    and J_t = min(mu J_n, m v_t) against v_t, with e from the damping ratio of solref. Measured:
    distance of the last velocity from that of the law, over the speed at the start. The first
    three degrees of freedom are slides along x, y and the normal z; there is no gravity.
    """
    before, after = context.trace.qvel[:, 0, :3], context.trace.qvel[:, -1, :3]
    push = -(1 + restitution_of_solref(context)) * before[:, 2]
    tangential = np.linalg.norm(before[:, :2], axis=1)
    lost = np.minimum(friction(context) * push, tangential)
    kept = 1 - lost / np.where(tangential > 0, tangential, 1)
    rebound = np.column_stack([before[:, :2] * kept[:, None], before[:, 2] + push])
    error = np.linalg.norm(after - rebound, axis=1)
    return np.zeros(context.trace.runs), error / np.linalg.norm(before, axis=1)


@oracle(unit="1", settings=("friction", "solref", "cut"), relative=False)
def throw(context: Context) -> tuple[Floats, Floats]:
    """Tangent of the angle by which friction throws a ball off the line of centres.

    mu while two equal solid balls slide on each other, and 2/7 tan(cut) / (1 + e) if friction
    stops that, whichever is less (Coulomb's law for impulses). Measured: velocity of the second
    free body, which was at rest, in the last state; line of centres at first touch.
    """
    kept = restitution_of_solref(context)
    stick = _BALL * np.tan(np.radians(context.setting("cut"))) / (1 + kept)
    pair = context.trace.pairs[0]
    first = pair.touching[:, :, 0].argmax(axis=1)
    line = pair.slots[np.arange(len(first)), first, 0, NORMAL]
    thrown = end_velocity(context, 1)
    along = np.abs((thrown * line).sum(axis=1))
    across = np.linalg.norm(np.cross(thrown, line), axis=1)
    return np.minimum(friction(context), stick), across / along


@oracle(unit="deg", settings=("angle",), relative=False)
def swing_transfer(context: Context) -> tuple[Floats, Floats]:
    """Angle to which the last pendulum of a cradle swings: that from which the first came.

    Equal balls hit one after the other hand on all of their momentum and energy. Measured: the
    last hinge's angle where it first comes to rest after it has left by over a degree.
    """
    swing = -context.trace.qpos[:, :, -1]
    out = swing > swing[:, :1] + np.radians(1)
    out[:, -1] = False
    rising = np.diff(swing, axis=1) > 0
    first = out.argmax(axis=1)
    after = np.arange(rising.shape[1]) >= first[:, None]
    peak = (after & ~rising).argmax(axis=1)
    highest = swing[np.arange(len(swing)), peak]
    measured = np.degrees(np.where(out.any(axis=1), highest, np.nan))
    return context.setting("angle"), measured
