"""Reads sweep files and plans their runs; reads other YAML files as models."""

from contactlab.plan.diagnostics import Diagnostic, Place, SourceText, SweepMistakesError
from contactlab.plan.grid import CONFIRM_ABOVE, MOST_RUNS, Match, Plan, Row, Run, SweptAxis
from contactlab.plan.overrides import Overrides
from contactlab.plan.starter import SCHEMA_NAME, starter
from contactlab.plan.sweep_file import SweepFile, read_sweep, read_yaml_as

__all__ = [
    "CONFIRM_ABOVE",
    "MOST_RUNS",
    "SCHEMA_NAME",
    "Diagnostic",
    "Match",
    "Overrides",
    "Place",
    "Plan",
    "Row",
    "Run",
    "SourceText",
    "SweepFile",
    "SweepMistakesError",
    "SweptAxis",
    "read_sweep",
    "read_yaml_as",
    "starter",
]
