"""Trace to metrics and labels: pure functions in tables."""

from contactlab.measure.assessment import Assessment, assess
from contactlab.measure.friction import pair_series
from contactlab.measure.label import Label, Outcome
from contactlab.measure.labels import LABELS
from contactlab.measure.metric import Metric
from contactlab.measure.metrics import METRICS
from contactlab.measure.modes import modes
from contactlab.measure.oracles import ORACLES, Oracle
from contactlab.measure.thresholds import THRESHOLDS, Threshold, limits

__all__ = [
    "LABELS",
    "METRICS",
    "ORACLES",
    "THRESHOLDS",
    "Assessment",
    "Label",
    "Metric",
    "Oracle",
    "Outcome",
    "Threshold",
    "assess",
    "limits",
    "modes",
    "pair_series",
]
