"""Measures and their limits, the results of checks, and the page that a report becomes.

An error is what a run of the model itself shows to be wrong, or what no physical body can be; a
warning is a rule of thumb of people who simulate contact with MuJoCo.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, starmap
from typing import NamedTuple

from contactlab.printable import in_markdown, shortened
from contactlab.run.evidence_record import as_written
from contactlab.schema.check_report import (
    CheckName,
    CheckReport,
    CheckResult,
    CheckVerdict,
    Finding,
    Measure,
    Remedy,
    Severity,
)
from contactlab.schema.comparison import CheckOutcome
from contactlab.schema.drive import drive_text


class Limit(NamedTuple):
    """The limit of all measures of one name: None where the model or its task decides.

    Where it is strict, the limit itself misses it; people read it times the factor in that unit.
    """

    unit: str
    severity: Severity
    value: float | None = None
    strict: bool = False
    shown: tuple[float, str] = (1.0, "")


_MM, _MS, _PERCENT = (1e3, " mm"), (1e3, " ms"), (1e2, " %/s")
LIMITS: Mapping[str, Limit] = {
    "timestep": Limit("s", "warning", shown=_MS),
    "step_ratio": Limit("1", "warning", 0.8),
    "travel": Limit("m", "error", shown=_MM),
    "energy_drift": Limit("1/s", "warning", 1e-3, shown=_PERCENT),
    "energy_gain": Limit("1/s", "error", 1e-2, shown=_PERCENT),
    "penetration_steady": Limit("m", "warning", 1e-4, strict=True, shown=_MM),
    "penetration_growth": Limit("m/s", "warning", 1e-6, shown=(1e6, " µm/s")),
    "steps_lost": Limit("1", "error", 1, strict=True),
    "mode_switches": Limit("1/s", "error", 5, strict=True, shown=(1.0, " a second")),
    "penetration_mean": Limit("m", "warning", 1e-3, strict=True, shown=_MM),
    "slip": Limit("m", "warning", 1e-4, strict=True, shown=_MM),
    "loose_share": Limit("1", "error", 0.5),
    "trajectories_differ": Limit("1", "error", 0),
    "shell": Limit("m", "warning", 1e-4, shown=_MM),
    "softness": Limit("s", "warning", 0.02, shown=_MS),
}
"""By the name of a measure, which is unique among all checks."""


REPLACEABLE = [*(name for name, each in LIMITS.items() if each.value is not None), "timestep"]
"""The limits that a request may replace by its own."""


def informative(name: str, value: float, unit: str, of: str | None = None) -> Measure:
    """Return a measure without a limit."""
    kept = value if math.isfinite(value) else None
    return Measure(name=name, of=of, value=kept, unit=unit, limit=None, holds=None)


def utilization(measure: Measure) -> float:
    """Return a measure as a fraction of its limit; infinite where it has no value."""
    if measure.value is None or measure.limit is None:
        return math.inf
    if not measure.limit:
        return math.inf if measure.value else 0.0
    return measure.value / measure.limit


def in_words(measure: Measure) -> str:
    """Return a limited measure as text: `slip 0.2 mm (floor-foot, limit 0.1 mm)`."""
    factor, unit = LIMITS[measure.name].shown if measure.name in LIMITS else (1.0, "")
    unit = unit or ("" if measure.unit == "1" else f" {measure.unit}")
    value = "none" if measure.value is None else f"{measure.value * factor:.3g}{unit}"
    of = f"{measure.of}, " if measure.of else ""
    limit = f"{(measure.limit or 0) * factor:.3g}{unit}"
    return f"{measure.name.replace('_', ' ')} {value} ({of}limit {limit})"


# What it means for a finding, and for its check, that a limit of some severity is missed.
_OUTCOMES: Mapping[str, CheckOutcome] = {"error": "failed", "warning": "warned", "note": "noted"}
_VERDICTS: Mapping[str, CheckVerdict] = {"error": "fail", "warning": "warning", "note": "pass"}


def violated(measures: Sequence[Measure]) -> list[Measure]:
    """Return the measures whose limit does not hold."""
    return [each for each in measures if each.holds is False]


def check_result(
    name: CheckName,
    asks: str,
    measures: Sequence[Measure],
    notes: Sequence[str] = (),
    stores: Sequence[str] = (),
) -> CheckResult:
    """Return the result of a check: a pass if every limit holds, else as bad as its worst miss.

    A check that measures nothing does not apply, for the reason that its first note gives.
    """
    if not measures:
        reason, *notes = notes
        verdict: CheckVerdict = "not applicable"
    else:
        worst = {each.severity for each in violated(measures)}
        verdict = _VERDICTS[next((each for each in _VERDICTS if each in worst), "note")]
        told = sorted(_by_name(measures), key=lambda group: not violated(group))
        reason = "; ".join(in_words(max(group, key=utilization)) for group in told)
    return CheckResult(
        name=name,
        asks=asks,
        verdict=verdict,
        reason=reason,
        measures=tuple(measures),
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


_DEFAULT_CURVE = (0.5, 2.0)  # midpoint and power of an impedance, where MJCF names none


def mjcf_text(value: object) -> str:
    """Return a value as MJCF has it; an impedance without the curve that it has by default."""
    if isinstance(value, tuple) and value[3:] == _DEFAULT_CURVE:
        value = value[:3]
    return str(as_written((value,) if isinstance(value, float) else value))


def settings_text(settings: Mapping[str, object]) -> str:
    """Return settings as text: `solref 0.005 1 and timestep 0.002`."""
    return " and ".join(f"{name} {mjcf_text(value)}" for name, value in settings.items())


MODEL = "remedies/model"  # where the model is written with all changes
STABILITY = (
    "check looks at what the model is made of and at one run; whether whole runs from several "
    "starts stay stable: contactlab stability {model}"
)
_WORDS = {"failed": "error", "warned": "warning", "noted": "note", "skipped": "n/a"}


def summary_rows(report: CheckReport) -> Iterator[tuple[str, str, str]]:
    """Yield what fails and is left out, worst first, then the checks that pass, as rows."""
    for each in report.findings:
        if each.outcome in _WORDS:
            yield _WORDS[each.outcome], each.name, each.full_message
    for check in report.checks:
        if check.verdict == "pass":
            yield "pass", check.name, check.reason


def remedy_lines(number: int, remedy: Remedy) -> Iterator[str]:
    """Yield the lines of a remedy: what it mends, its price, and what it changes in the model."""
    settings = ", ".join(f"{name} {mjcf_text(value)}" for name, value in remedy.settings.items())
    price = "" if remedy.time is None else f"; steps take {remedy.time:.2g} times as long"
    yield f"{number}. {settings} mends {', '.join(remedy.mends)}{price}"
    edits = [f"{edit.where}: {line}" for edit in remedy.edits for line in edit.lines]
    yield from (f"   {line}" for line in shortened(edits, 12, f"a patch in {MODEL}"))


REMEDIES = "changes that help, each run on the model with those above it:"


def page(report: CheckReport) -> str:
    """Return a report as a Markdown page."""
    return "".join(f"{each}\n\n" for each in _paragraphs(report))


def _paragraphs(report: CheckReport) -> Iterator[str]:
    yield f"# {report.scene}: {'passes' if report.passed else 'fails'}"
    given = "".join(f" --set '{each}'" for each in report.overrides)
    yield f"    contactlab check {report.model}{given}"
    yield (
        f"Model `{report.model}` ({report.scene_hash}), {conditions(report)}; "
        f"{report.engine.name} {report.engine.version}."
    )
    rows = (
        f"| {word} | {name} | {in_markdown(what)} |" for word, name, what in summary_rows(report)
    )
    yield "\n".join(("| | finding | result |", "|---|---|---|", *rows))
    yield "\n".join(f"- {note}" for note in (*report.notes, STABILITY.format(model=report.model)))
    if report.remedies:
        yield "## Remedies"
        yield REMEDIES.capitalize()
        lines = chain.from_iterable(starmap(remedy_lines, enumerate(report.remedies, 1)))
        yield "\n".join(("```", *lines, "```"))
    for check in report.checks:
        yield from _check(check)


def conditions(report: CheckReport) -> str:
    """Return in words where runs start, what drives them, and the kind of task."""
    start = f"keyframe {report.keyframe}" if report.keyframe else "its initial state"
    drive = drive_text(report.drive)
    driven = "driven by nothing" if drive == "none" else f"driven by {drive}"
    return f"from {start}, {driven}, for {report.kind} ({report.kind_reason})"


def _check(check: CheckResult) -> Iterator[str]:
    yield f"## {check.name}: {check.verdict}"
    yield f"Criterion: {check.asks}."
    yield f"{check.reason[:1].upper()}{check.reason[1:]}."
    if check.measures:
        header = ("| number | of | value | limit | |", "|---|---|---|---|---|")
        yield "\n".join((*header, *map(_row, check.measures)))
    if check.notes:
        yield "\n".join(f"- {note}" for note in check.notes)
    if check.stores:
        yield f"Evidence: {', '.join(f'`{each}`' for each in check.stores)}."


def _row(measure: Measure) -> str:
    verdict = {None: "", True: "holds", False: "**violated**"}[measure.holds]
    limit = "" if measure.limit is None else _number(measure.limit, measure.unit)
    name, of = measure.name.replace("_", " "), in_markdown(measure.of or "")
    return f"| {name} | {of} | {_number(measure.value, measure.unit)} | {limit} | {verdict} |"


def _number(value: float | None, unit: str) -> str:
    if value is None:
        return "none"
    return f"{value:.4g}" + ("" if unit == "1" else f" {unit}")
