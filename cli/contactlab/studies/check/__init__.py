"""Checks of a model, by published guidelines, and what to change where it fails."""

from contactlab.registry import settle
from contactlab.studies.check import own_runs

TOPICS = (own_runs,)
"""Modules that declare checks."""
settle()
