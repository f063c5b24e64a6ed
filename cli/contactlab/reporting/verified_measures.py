"""Describes the measures of a verification: numbers before and after, with their unit."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from contactlab.rendering.amounts import format_digits
from contactlab.schema.verification import VerifiedMeasure

_SCALES = {"m": (1e3, "mm"), "rad": (180 / math.pi, "deg"), "m/s": (1e3, "mm/s"), "1": (1.0, "")}
ERROR = "numerical error"
_SHARES = {ERROR, "energy gain", "energy error", "grip depth"}


class MeasureRow(NamedTuple):
    """A measure as a row of a table; its numbers have the same unit."""

    name: str
    run: str
    before: str
    after: str
    tolerance: str
    unit: str
    place: str


def measure_rows(measures: Sequence[VerifiedMeasure]) -> list[MeasureRow]:
    """Return measures as rows of a table, those with the largest change first."""
    ranked = sorted(measures, key=measure_change, reverse=True)
    return [_measure_row(measure) for measure in ranked]


def measure_change(measure: VerifiedMeasure) -> float:
    """Return the change of a measure over its tolerance."""
    if measure.after is None or measure.before is None:
        return math.inf if measure.after != measure.before else 0.0
    return abs(measure.after - measure.before) / max(measure.tolerance, 1e-300)


def _measure_row(measure: VerifiedMeasure) -> MeasureRow:
    factor, unit = _SCALES.get(measure.unit, (1.0, measure.unit))
    if measure.name in _SHARES:
        factor, unit = 100.0, "%"
    before, after, tolerance = (
        "infinite" if value is None else format_digits(factor * value)
        for value in (measure.before, measure.after, measure.tolerance)
    )
    return MeasureRow(measure.name, measure.run, before, after, tolerance, unit, measure.place)


def describe_measure(measure: VerifiedMeasure) -> str:
    """Return a measure before and after, such as "creep 0 -> 0.99 mm/s (tilted; box)"."""
    row = _measure_row(measure)
    where = "; ".join(filter(None, (row.run, row.place)))
    if measure.name == ERROR and measure.before and measure.after is not None:
        # Both are measured from the states of one motion, so that their ratio is that of errors.
        ratio = format_digits(measure.after / measure.before)
        return f"{row.name} {ratio} times as large ({where})"
    return f"{row.name} {row.before} -> {row.after}{' ' * bool(row.unit)}{row.unit} ({where})"
