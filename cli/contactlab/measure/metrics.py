"""The table of metrics."""

from collections.abc import Mapping
from types import MappingProxyType

from contactlab.measure.conservation import CONSERVATION
from contactlab.measure.metric import Metric
from contactlab.measure.oracles import ORACLE_METRICS
from contactlab.measure.penetration import PENETRATION
from contactlab.measure.restitution import RESTITUTION
from contactlab.measure.sliding import SLIDING
from contactlab.measure.solver import SOLVER

METRICS: Mapping[str, Metric] = MappingProxyType(
    {
        metric.name: metric
        for metric in (
            *PENETRATION,
            *CONSERVATION,
            *RESTITUTION,
            *SLIDING,
            *SOLVER,
            *ORACLE_METRICS,
        )
    }
)
