"""Verdicts as numbers, so that a million of them are one array."""

from typing import get_args

from contactlab.schema.comparison_report import Verdict

# Ordered from good to bad, so that the worst of many is their maximum.
NAMES: tuple[Verdict, ...] = ("same", "better", "changed", "worse", "missing", "not comparable")
SAME, BETTER, CHANGED, WORSE, MISSING, NOT_COMPARABLE = range(len(NAMES))
assert set(NAMES) == set(get_args(Verdict))
