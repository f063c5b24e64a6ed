"""Traces to metrics and labels. A plug-in declares its own with the decorators exported here."""

from importlib import import_module
from pkgutil import iter_modules

# The order of these imports is the order of metrics, and so of columns.
# isort: off
from contactlab.measure import penetration, motion, soft_contact, friction
from contactlab.measure import grasp_hold, solver_work, oracle_error

# isort: on
from contactlab.contact.trace_arrays import Floats
from contactlab.measure.assessment import AppliedLabel, Assessment, assess
from contactlab.measure.context import (
    Context,
    cached,
    contact_depths,
    context_of,
    first_step,
    runs_where,
    worst_pair,
)
from contactlab.measure.entries import (
    LABELS,
    METRICS,
    ORACLES,
    THRESHOLDS,
    Finding,
    Findings,
    Found,
    Label,
    MeasuredRuns,
    Metric,
    Requirement,
    Threshold,
    label,
    limits,
    metric,
    oracle,
)
from contactlab.measure.run_integrity import STABLE

__all__ = [
    "LABELS",
    "METRICS",
    "ORACLES",
    "STABLE",
    "THRESHOLDS",
    "AppliedLabel",
    "Assessment",
    "Context",
    "Finding",
    "Findings",
    "Floats",
    "Found",
    "Label",
    "MeasuredRuns",
    "Metric",
    "Requirement",
    "Threshold",
    "assess",
    "cached",
    "contact_depths",
    "context_of",
    "first_step",
    "label",
    "limits",
    "metric",
    "oracle",
    "runs_where",
    "worst_pair",
]

TOPICS = penetration, motion, soft_contact, friction, grasp_hold, solver_work, oracle_error
"""Modules that declare metrics, in the order of the table's columns; others come after them."""

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")
