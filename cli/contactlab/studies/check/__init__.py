"""Checks of a model, by published guidelines, and what to change where it fails."""

from contactlab.studies.check.model_check import PAGE, REPORT, CheckRequest, run

__all__ = [
    "PAGE",
    "REPORT",
    "CheckRequest",
    "run",
]
