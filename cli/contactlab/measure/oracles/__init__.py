"""Closed forms that scenes are measured against, by name."""

from contactlab.errors import SceneError, did_you_mean
from contactlab.measure.context import Context, shared
from contactlab.measure.metric import Metric
from contactlab.measure.oracles.oracle import Oracle, OracleResult
from contactlab.measure.oracles.restitution import RESTITUTION_LAW
from contactlab.measure.oracles.sliding_distance import SLIDING_DISTANCE
from contactlab.measure.oracles.stack_sag import STACK_SAG
from contactlab.trace import Floats

__all__ = ["ORACLES", "ORACLE_METRICS", "Oracle", "OracleResult"]

ORACLES = {each.name: each for each in (RESTITUTION_LAW, SLIDING_DISTANCE, STACK_SAG)}


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
