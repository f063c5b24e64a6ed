"""Lint rules for model files, which are compiled but not stepped: `contactlab lint`."""

from contactlab.registry import settle
from contactlab.studies.lint import (
    capacity,
    contacts,
    files,
    gains,
    masses,
    names,
    options,
    overlaps,
    starts,
)

TOPICS = capacity, contacts, files, gains, masses, names, options, overlaps, starts
"""Modules that declare rules."""
settle()
