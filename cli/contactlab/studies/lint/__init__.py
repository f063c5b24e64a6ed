"""Lint rules for model files, which are compiled but not stepped: `contactlab lint`."""

from contactlab.registry import settle
from contactlab.studies.lint import (
    advisories,
    capacity,
    contacts,
    files,
    gains,
    loads,
    masses,
    names,
    options,
    overlaps,
    servos,
    starts,
    structure,
)

TOPICS = (
    advisories,
    capacity,
    contacts,
    files,
    gains,
    loads,
    masses,
    names,
    options,
    overlaps,
    servos,
    starts,
    structure,
)
"""Modules that declare rules."""
settle()
