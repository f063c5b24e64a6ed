"""The results of checks, and what they find."""

from collections.abc import Iterator, Mapping, Sequence

from contactlab.run.evidence_record import as_written
from contactlab.schema.check_report import CheckName, CheckResult, CheckVerdict, Finding, Measure
from contactlab.schema.judged_check import CheckOutcome
from contactlab.studies.check.limits import in_words, utilization

_OUTCOMES: Mapping[str, CheckOutcome] = {"error": "failed", "warning": "warned", "note": "noted"}
_VERDICTS: Mapping[str, CheckVerdict] = {"error": "fail", "warning": "warning", "note": "pass"}


def violated(measures: Sequence[Measure]) -> list[Measure]:
    """Return the measures whose limit does not hold."""
    return [each for each in measures if each.holds is False]


def check_result(
    name: CheckName,
    asks: str,
    measures: Sequence[Measure],
    *,
    notes: Sequence[str] = (),
    stores: Sequence[str] = (),
) -> CheckResult:
    """Return the result of a check: a pass if every limit holds, else as bad as its worst miss."""
    worst = {each.severity for each in violated(measures)}
    severity = next((each for each in _VERDICTS if each in worst), "note")
    told = sorted(_by_name(measures), key=lambda group: not violated(group))
    return CheckResult(
        name=name,
        asks=asks,
        verdict=_VERDICTS[severity],
        reason="; ".join(in_words(max(group, key=utilization)) for group in told),
        measures=tuple(measures),
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


def findings_of(result: CheckResult) -> Iterator[Finding]:
    """Yield what a check finds: one finding for all limited measures of one name."""
    if result.verdict == "not applicable":
        yield Finding(
            name=result.name,
            check=result.name,
            severity="note",
            outcome="skipped",
            failing=0,
            message=result.reason,
        )
    for group in _by_name(result.measures):
        failing = violated(group)
        worst = max(failing or group, key=utilization)
        count = f"; {len(failing)} of {len(group)} miss it" if failing and len(group) > 1 else ""
        yield Finding(
            name=worst.name,
            check=result.name,
            severity=worst.severity,
            outcome=_OUTCOMES[worst.severity] if failing else "passed",
            failing=len(failing),
            message=in_words(worst) + count,
        )


def _by_name(measures: Sequence[Measure]) -> list[list[Measure]]:
    groups: dict[str, list[Measure]] = {}
    for each in measures:
        if each.limit is not None:
            groups.setdefault(each.name, []).append(each)
    return list(groups.values())


_DEFAULT_CURVE = (0.5, 2.0)
"""Midpoint and power of an impedance, where MJCF names none."""


def mjcf_text(value: object) -> str:
    """Return a value as MJCF has it; an impedance without the curve that it has by default."""
    if isinstance(value, tuple) and value[3:] == _DEFAULT_CURVE:
        value = value[:3]
    return str(as_written((value,) if isinstance(value, float) else value))


def settings_text(settings: Mapping[str, object]) -> str:
    """Return settings as text: `solref 0.005 1 and timestep 0.002`."""
    return " and ".join(f"{name} {mjcf_text(value)}" for name, value in settings.items())
