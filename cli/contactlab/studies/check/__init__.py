"""Checks of a model before it is trusted, and what to change where it fails."""

from contactlab.studies.check.model_check import CHECKS, PAGE, REPORT, CheckRequest, check_model

__all__ = [
    "CHECKS",
    "PAGE",
    "REPORT",
    "CheckRequest",
    "check_model",
]
