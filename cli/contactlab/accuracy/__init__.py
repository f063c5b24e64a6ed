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
from contactlab.accuracy.timing import InterleavedTimer, count_works, timing_seconds, timings

__all__ = [
    "InterleavedTimer",
    "Note",
    "PlannedModel",
    "accuracies",
    "count_works",
    "discretization_errors",
    "families",
    "raises_solref",
    "reference_steps",
    "timing_seconds",
    "timings",
]
