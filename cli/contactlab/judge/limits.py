"""Limits of measured values and of changes, and the findings that measures make of them."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np
from numpy.typing import NDArray

from contactlab.judge.subjects import OUTCOMES
from contactlab.numerical_tolerance import SUM_ROUNDING
from contactlab.registry import Registry
from contactlab.schema.check_report import Measure
from contactlab.schema.finding import Finding, Level


@dataclass(frozen=True)
class Limit:
    """The largest value of a quantity, or its largest change; without a value it is set later.

    Attributes:
        name: of the quantity.
        unit: its unit; `1` for counts and ratios.
        level: effect on the job if the limit is exceeded.
        value: the limit, in that unit.
        strict: whether a value equal to the limit exceeds it.
        printed_unit: the factor and the unit for output.
        exceeded: sentence for a value beyond it, with {} for the value; otherwise its name.
        relative: further change that is allowed, as a share of the reference.
    """

    name: str
    unit: str
    level: Level = "gate"
    value: float | None = None
    strict: bool = False
    printed_unit: tuple[float, str] = (1.0, "")
    exceeded: str = ""
    relative: float = 0.0

    @overload
    def allow_change(self, reference: float) -> float: ...

    @overload
    def allow_change(self, reference: NDArray[np.float64]) -> NDArray[np.float64]: ...

    def allow_change(self, reference: float | NDArray[np.float64]) -> float | NDArray[np.float64]:
        """Return the allowed change of references: `value + relative |reference|`."""
        return (self.value or 0.0) + self.relative * abs(reference)

    def measure(
        self, value: float, of: str | None, bound: float | None = None, level: Level | None = None
    ) -> Measure:
        """Return a value, and whether it keeps a bound, by default the limit; NaN never does."""
        bound = self.value if bound is None else bound
        assert bound is not None
        slack = 1 + SUM_ROUNDING  # keeps a value that equals its limit within it
        return Measure(
            name=self.name,
            of=of,
            value=value,
            unit=self.unit,
            limit=bound,
            holds=bool(value < bound if self.strict else value <= bound * slack),
            level=level or self.level,
        )

    def sentence(self, measure: Measure) -> str:
        """Return a measure as text: `slip 0.2 mm (floor-foot, limit 0.1 mm)`."""
        factor, unit = self.printed_unit
        unit = unit or ("" if measure.unit == "1" else f" {measure.unit}")
        value = "not measured" if measure.value is None else f"{measure.value * factor:.3g}{unit}"
        of = f"{measure.of}, " if measure.of else ""
        limit = f"{(measure.limit or 0) * factor:.3g}{unit}"
        sentence = f"{measure.name.replace('_', ' ')} {{}}"
        if measure.holds is False and measure.value is not None:
            sentence = self.exceeded or sentence
        return f"{sentence.format(value)} ({of}limit {limit})"


MILLIMETRES, MILLISECONDS = (1e3, " mm"), (1e3, " ms")
PERCENT = (1e2, " %")
LIMITS: Registry[Limit] = Registry("limit")
"""By the name of a measure, which is unique among all checks; each check adds its own."""


def informative(name: str, value: float, unit: str, of: str | None = None) -> Measure:
    """Return a measure without a limit."""
    return Measure(name=name, of=of, value=value, unit=unit, limit=None, holds=None)


def utilization(value: float | None, limit: float | None) -> float:
    """Return a value as a fraction of its limit; infinite without a limit."""
    if value is None or limit is None:
        return math.inf
    if not limit:
        return math.inf if value else 0.0
    return value / limit


def worst_of(measures: Sequence[Measure]) -> Measure:
    """Return the measure that uses most of its limit."""
    return max(measures, key=lambda measure: utilization(measure.value, measure.limit))


def in_words(measure: Measure) -> str:
    """Return a limited measure as text: `slip 0.2 mm (floor-foot, limit 0.1 mm)`."""
    return LIMITS.get(measure.name, Limit(measure.name, measure.unit)).sentence(measure)


def find_exceeding(measures: Sequence[Measure]) -> list[Measure]:
    """Return the measures above their limit."""
    return [measure for measure in measures if measure.holds is False]


def find_limited(measures: Sequence[Measure]) -> list[list[Measure]]:
    """Return the measures that have a limit, by name."""
    groups: dict[str, list[Measure]] = {}
    for measure in measures:
        if measure.limit is not None:
            groups.setdefault(measure.name, []).append(measure)
    return list(groups.values())


def limit_findings(kind: str, measures: Sequence[Measure]) -> Iterator[Finding]:
    """Yield a finding for all limited measures of one name."""
    for group in find_limited(measures):
        failing = find_exceeding(group)
        worst = worst_of(failing or group)
        yield Finding(
            name=worst.name,
            kind=kind,
            level=worst.level,
            outcome=OUTCOMES[worst.level] if failing else "passed",
            verdict="unmet" if failing else "met",
            judged=len(group),
            failing=len(failing),
            message=in_words(worst) + _count_in_words(len(failing), len(group)),
            value=worst.value,
            limit=worst.limit,
            unit=worst.unit,
        )


def _count_in_words(failing: int, all_of_them: int) -> str:
    """Return how many of some measures exceed their limit; nothing of one, or where none does."""
    if not failing or all_of_them == 1:
        return ""
    if failing == all_of_them:
        words = {2: "both"}
        return f"; {words.get(failing, f'all {failing}')} exceed the limit"
    return f"; {failing} of {all_of_them} exceed{'s' if failing == 1 else ''} the limit"
