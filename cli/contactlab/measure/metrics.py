"""The table of metrics."""

from collections.abc import Mapping
from types import MappingProxyType

from contactlab.measure.checks import CHECKS
from contactlab.measure.conservation import CONSERVATION
from contactlab.measure.hold import HOLD
from contactlab.measure.losses import LOSSES
from contactlab.measure.metric import Metric
from contactlab.measure.oracles import ORACLE_METRICS
from contactlab.measure.penetration import PENETRATION
from contactlab.measure.rest import REST
from contactlab.measure.restitution import RESTITUTION
from contactlab.measure.sliding import SLIDING
from contactlab.measure.solver import SOLVER
from contactlab.measure.travel import TRAVEL

METRICS: Mapping[str, Metric] = MappingProxyType(
    {
        metric.name: metric
        for metric in (
            *PENETRATION,
            *CONSERVATION,
            *REST,
            *TRAVEL,
            *RESTITUTION,
            *SLIDING,
            *LOSSES,
            *HOLD,
            *SOLVER,
            *CHECKS,
            *ORACLE_METRICS,
        )
    }
)
