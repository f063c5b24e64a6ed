"""Measures against limits, changes with their MJCF, and the results of checks."""

import math
from collections.abc import Sequence

from contactlab.mjcf import CONTACT, OPTIONS, default_lines, option_lines
from contactlab.run.evidence_record import as_written
from contactlab.schema.check_report import Change, CheckName, CheckResult, Measure
from contactlab.studies.check.checked_model import CheckedModel
from contactlab.studies.session import Values


def upper_limit(name: str, value: float, unit: str, limit: float, of: str | None = None) -> Measure:
    """Return a measure whose limit holds if the value is at most the limit; NaN never holds."""
    return Measure(
        name=name,
        of=of,
        value=value if math.isfinite(value) else None,
        unit=unit,
        limit=limit,
        holds=bool(value <= limit),
    )


def strict_limit(
    name: str, value: float, unit: str, limit: float, of: str | None = None
) -> Measure:
    """Return a measure whose limit holds if the value is below the limit; NaN never holds."""
    return upper_limit(name, value, unit, limit, of).model_copy(
        update={"holds": bool(value < limit)}
    )


def informative(name: str, value: float, unit: str, of: str | None = None) -> Measure:
    """Return a measure without a limit."""
    kept = value if math.isfinite(value) else None
    return Measure(name=name, of=of, value=kept, unit=unit, limit=None, holds=None)


def violated(measures: Sequence[Measure]) -> list[Measure]:
    """Return the measures whose limit does not hold."""
    return [each for each in measures if each.holds is False]


def check_result(  # noqa: PLR0913 - the parts of a result
    name: CheckName,
    asks: str,
    reason: str,
    measures: Sequence[Measure],
    *,
    changes: Sequence[Change] = (),
    notes: Sequence[str] = (),
    stores: Sequence[str] = (),
) -> CheckResult:
    """Return the result of a check: a pass if every limit holds."""
    return CheckResult(
        name=name,
        asks=asks,
        verdict="fail" if violated(measures) else "pass",
        reason=reason,
        measures=tuple(measures),
        changes=tuple(changes),
        notes=tuple(notes),
        stores=tuple(stores),
    )


def not_applicable(
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


_DEFAULT_CURVE = (0.5, 2.0)
"""Midpoint and power of an impedance, where MJCF names none."""


def change(checked: CheckedModel, settings: Values, *, cures: bool | None, shown: str) -> Change:
    """Return a change of settings, with the lines that make it in a model.

    Args:
        checked: the model; whether it has <pair> elements decides where contact parameters stand.
        settings: values by axis: options and contact parameters.
        cures: whether the check passed with it; None if that was not run.
        shown: what running it gave.
    """
    texts = {name: mjcf_text(value) for name, value in settings.items()}
    options = {name: text for name, text in texts.items() if name in OPTIONS}
    contact = {name: texts[name] for name in CONTACT if name in texts}
    elements = ("geom", "pair") if checked.base.targets.explicit else ("geom",)
    return Change(
        lines=(*option_lines(options, {}), *default_lines(contact, elements)),
        settings={name: as_written(value) for name, value in settings.items()},
        cures=cures,
        shown=shown,
    )


def mjcf_text(value: object) -> str:
    """Return a value as MJCF has it; an impedance without the curve that it has by default."""
    if isinstance(value, tuple) and value[3:] == _DEFAULT_CURVE:
        value = value[:3]
    return str(as_written((value,) if isinstance(value, float) else value))
