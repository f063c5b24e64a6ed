"""From numbers and limits to the result of a check."""

import math
from collections.abc import Sequence

from contactlab.schema import Change, CheckName, CheckResult, Measure


def at_most(name: str, value: float, unit: str, limit: float, of: str | None = None) -> Measure:
    """Return a measure that must not be above its limit; what is not a number does not hold."""
    return Measure(
        name=name,
        of=of,
        value=value if math.isfinite(value) else None,
        unit=unit,
        limit=limit,
        holds=bool(value <= limit),
    )


def below(name: str, value: float, unit: str, limit: float, of: str | None = None) -> Measure:
    """Return a measure that must be under its limit; what is not a number does not hold."""
    return at_most(name, value, unit, limit, of).model_copy(update={"holds": bool(value < limit)})


def noted(name: str, value: float, unit: str, of: str | None = None) -> Measure:
    """Return a measure that only informs."""
    kept = value if math.isfinite(value) else None
    return Measure(name=name, of=of, value=kept, unit=unit, limit=None, holds=None)


def missed(measures: Sequence[Measure]) -> list[Measure]:
    """Return the measures whose limit is not kept."""
    return [each for each in measures if each.holds is False]


def result(  # noqa: PLR0913 - the parts of a result
    name: CheckName,
    asks: str,
    reason: str,
    measures: Sequence[Measure],
    *,
    changes: Sequence[Change] = (),
    notes: Sequence[str] = (),
    stores: Sequence[str] = (),
) -> CheckResult:
    """Return the result of a check: a pass unless a limit is not kept."""
    return CheckResult(
        name=name,
        asks=asks,
        verdict="fail" if missed(measures) else "pass",
        reason=reason,
        measures=tuple(measures),
        changes=tuple(changes),
        notes=tuple(notes),
        stores=tuple(stores),
    )


def inapplicable(
    name: CheckName,
    asks: str,
    reason: str,
    *,
    notes: Sequence[str] = (),
    stores: Sequence[str] = (),
) -> CheckResult:
    """Return the result of a check that does not apply."""
    return CheckResult(
        name=name,
        asks=asks,
        verdict="not applicable",
        reason=reason,
        notes=tuple(notes),
        stores=tuple(stores),
    )
