"""Checks of a model before it is trusted, and what to change where it fails."""

from contactlab.studies.check.checking import CHECKS, PAGE, REPORT, CheckAsk, check_model

__all__ = [
    "CHECKS",
    "PAGE",
    "REPORT",
    "CheckAsk",
    "check_model",
]
