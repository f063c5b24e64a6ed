"""A sweep file and the runs that it asks for; other files that people write."""

from contactlab.plan.diagnostic import Diagnostic, Place, Source, SweepMistakesError
from contactlab.plan.other import read_as
from contactlab.plan.override import Overrides
from contactlab.plan.plan import CONFIRM_ABOVE, MOST_RUNS, Plan, Row, Run, SweptAxis
from contactlab.plan.reading import SweepFile, read_sweep
from contactlab.plan.rows import Match
from contactlab.plan.starter import SCHEMA_NAME, starter

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
    "Source",
    "SweepFile",
    "SweepMistakesError",
    "SweptAxis",
    "read_as",
    "read_sweep",
    "starter",
]
