"""How far runs are from the limit of small timesteps, and what they cost by themselves."""

from contactlab.accuracy.discretization import (
    Note,
    accuracies,
    discretization_errors,
    families,
    reference_steps,
)
from contactlab.accuracy.reference import PlannedModel
from contactlab.accuracy.refsafe import raises_solref
from contactlab.accuracy.timing import InterleavedTimer, timing_seconds, timings, work_of_runs

__all__ = [
    "InterleavedTimer",
    "Note",
    "PlannedModel",
    "accuracies",
    "discretization_errors",
    "families",
    "raises_solref",
    "reference_steps",
    "timing_seconds",
    "timings",
    "work_of_runs",
]
