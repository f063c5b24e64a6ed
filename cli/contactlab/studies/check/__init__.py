"""Checks of a model for CI."""

from contactlab.registry import settle
from contactlab.studies.check import own_runs

TOPICS = (own_runs,)
"""Modules that declare checks."""
settle()
