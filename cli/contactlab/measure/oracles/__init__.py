"""Closed forms that scenes are measured against, by name."""

from contactlab.contact import Floats
from contactlab.errors import SceneError, did_you_mean
from contactlab.measure.context import Context, shared
from contactlab.measure.metric import Metric
from contactlab.measure.oracles.braking_angle import BRAKING_ANGLE
from contactlab.measure.oracles.conserved_energy import CONSERVED_ENERGY
from contactlab.measure.oracles.dry_friction import INCLINE, PUSHED_BOX
from contactlab.measure.oracles.flip_time import FLIP_TIME
from contactlab.measure.oracles.foot_depth import FOOT_DEPTH
from contactlab.measure.oracles.free_fall import FREE_FALL
from contactlab.measure.oracles.impact_depth import IMPACT_DEPTH
from contactlab.measure.oracles.ladder import LADDER
from contactlab.measure.oracles.oblique_impact import OBLIQUE_IMPACT
from contactlab.measure.oracles.oracle import Oracle, OracleResult
from contactlab.measure.oracles.pair_restitution import PAIR_RESTITUTION
from contactlab.measure.oracles.precession import PRECESSION
from contactlab.measure.oracles.rest_penetration import REST_PENETRATION
from contactlab.measure.oracles.restitution import RESTITUTION_LAW
from contactlab.measure.oracles.rolling import ROLL_DOWN, ROLL_FRICTION, SLIDE_TO_ROLL, SPIN_DOWN
from contactlab.measure.oracles.rolling_plate import ROLLING_PLATE
from contactlab.measure.oracles.separation_speed import SEPARATION_SPEED
from contactlab.measure.oracles.sliding_distance import SLIDING_DISTANCE
from contactlab.measure.oracles.stack_sag import STACK_SAG
from contactlab.measure.oracles.swing_transfer import SWING_TRANSFER
from contactlab.measure.oracles.throw import THROW
from contactlab.measure.oracles.tip_travel import TIP_TRAVEL

__all__ = ["ORACLES", "ORACLE_METRICS", "Oracle", "OracleResult"]

ORACLES = {
    each.name: each
    for each in (
        RESTITUTION_LAW,
        SLIDING_DISTANCE,
        STACK_SAG,
        FREE_FALL,
        REST_PENETRATION,
        OBLIQUE_IMPACT,
        IMPACT_DEPTH,
        INCLINE,
        PUSHED_BOX,
        ROLL_DOWN,
        SLIDE_TO_ROLL,
        ROLL_FRICTION,
        SPIN_DOWN,
        ROLLING_PLATE,
        LADDER,
        FLIP_TIME,
        PRECESSION,
        CONSERVED_ENERGY,
        SWING_TRANSFER,
        SEPARATION_SPEED,
        BRAKING_ANGLE,
        PAIR_RESTITUTION,
        THROW,
        TIP_TRAVEL,
        FOOT_DEPTH,
    )
}


@shared
def _result(context: Context) -> OracleResult:
    name = context.setup.oracle
    if name is None:
        return OracleResult(context.nothing(), context.nothing(), context.nothing())
    if name not in ORACLES:
        known = ", ".join(ORACLES)
        raise SceneError(f"no oracle '{name}'{did_you_mean(name, ORACLES)}; there are {known}")
    return ORACLES[name].of(context)


def _expected(context: Context) -> Floats:
    return _result(context).expected


def _measured(context: Context) -> Floats:
    return _result(context).measured


def _error(context: Context) -> Floats:
    return _result(context).error


ORACLE_METRICS = (
    Metric(
        "oracle_expected",
        "any",
        "none",
        0,
        1,
        "What the scene's closed form expects, in the unit of that oracle.",
        _expected,
    ),
    Metric(
        "oracle_measured",
        "any",
        "none",
        0,
        1,
        "What was measured of it, in the same unit.",
        _measured,
    ),
    Metric(
        "oracle_error",
        "any",
        "lower",
        1e-9,
        1,
        "Distance between the two, as a share of what is expected or in its unit, as the oracle "
        "says. It holds the modelling error of soft contact, which no timestep removes, and the "
        "error of discretisation.",
        _error,
    ),
)
