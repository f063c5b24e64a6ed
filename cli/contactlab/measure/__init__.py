"""Trace to metrics and labels: pure functions in tables."""

from contactlab.measure.assessment import Assessment, assess
from contactlab.measure.checks import CHECKS
from contactlab.measure.discrepancy import Discrepancy, distances, drifts
from contactlab.measure.friction import pair_series
from contactlab.measure.label import Label, Outcome
from contactlab.measure.labels import LABELS
from contactlab.measure.metric import Metric
from contactlab.measure.metrics import METRICS
from contactlab.measure.modes import modes
from contactlab.measure.oracles import ORACLES, Oracle
from contactlab.measure.thresholds import THRESHOLDS, Threshold, limits

__all__ = [
    "CHECKS",
    "LABELS",
    "METRICS",
    "ORACLES",
    "THRESHOLDS",
    "Assessment",
    "Discrepancy",
    "Label",
    "Metric",
    "Oracle",
    "Outcome",
    "Threshold",
    "assess",
    "distances",
    "drifts",
    "limits",
    "modes",
    "pair_series",
]
