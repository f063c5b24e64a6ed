"""Measures and their limits, the results of checks, and the page that a report becomes.

An error is what a run of the model itself shows to be wrong, or what no physical body can be; a
warning is a rule of thumb of people who simulate contact with MuJoCo.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, starmap

from contactlab.printable import in_markdown, shortened
from contactlab.registry import Registry
from contactlab.run.evidence_record import as_written
from contactlab.schema.check_report import (
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


@dataclass(frozen=True)
class Limit:
    """The limit of all measures of one name: without a value, the model or its task decides.

    Where it is strict, the limit itself misses it; people read it times the factor in that unit.
    """

    name: str
    unit: str
    severity: Severity
    value: float | None = None
    strict: bool = False
    shown: tuple[float, str] = (1.0, "")
    exceeded: str = ""  # sentence of a measure beyond it, with {} for the value; else its name


MILLIMETRES, MILLISECONDS = (1e3, " mm"), (1e3, " ms")
PERCENT, PERCENT_PER_SECOND = (1e2, " %"), (1e2, " %/s")
LIMITS: Registry[Limit] = Registry("limit")
"""By the name of a measure, which is unique among all checks; each check adds its own."""


def replaceable_limits() -> list[str]:
    """Return the names of the limits that a request may replace by its own."""
    return [*(name for name, limit in LIMITS.items() if limit.value is not None), "timestep"]


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
    value = "not measured" if measure.value is None else f"{measure.value * factor:.3g}{unit}"
    of = f"{measure.of}, " if measure.of else ""
    limit = f"{(measure.limit or 0) * factor:.3g}{unit}"
    sentence = f"{measure.name.replace('_', ' ')} {{}}"
    if measure.holds is False and measure.value is not None and measure.name in LIMITS:
        sentence = LIMITS[measure.name].exceeded or sentence
    return f"{sentence.format(value)} ({of}limit {limit})"


# What it means for a finding, and for its check, that a limit of some severity is missed.
_OUTCOMES: Mapping[str, CheckOutcome] = {"error": "failed", "warning": "warned", "note": "noted"}
_VERDICTS: Mapping[str, CheckVerdict] = {"error": "fail", "warning": "warning", "note": "pass"}


def violated(measures: Sequence[Measure]) -> list[Measure]:
    """Return the measures whose limit does not hold."""
    return [measure for measure in measures if measure.holds is False]


def check_result(
    name: str,
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
        worst = {measure.severity for measure in violated(measures)}
        verdict = _VERDICTS[next((severity for severity in _VERDICTS if severity in worst), "note")]
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
        count = _count_in_words(len(failing), len(group))
        yield Finding(
            name=worst.name,
            check=result.name,
            severity=worst.severity,
            outcome=_OUTCOMES[worst.severity] if failing else "passed",
            failing=len(failing),
            message=in_words(worst) + count,
        )


def _count_in_words(failing: int, all_of_them: int) -> str:
    """Return how many of some measures exceed their limit; nothing of one, or where none does."""
    if not failing or all_of_them == 1:
        return ""
    if failing == all_of_them:
        return f"; all {failing} exceed the limit"
    return f"; {failing} of {all_of_them} exceed{'s' if failing == 1 else ''} the limit"


def _by_name(measures: Sequence[Measure]) -> list[list[Measure]]:
    groups: dict[str, list[Measure]] = {}
    for measure in measures:
        if measure.limit is not None:
            groups.setdefault(measure.name, []).append(measure)
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
    for finding in report.findings:
        if finding.outcome in _WORDS:
            yield _WORDS[finding.outcome], finding.name, finding.full_message
    for check in report.checks:
        if check.verdict == "pass":
            yield "pass", check.name, check.reason


def remedy_lines(number: int, remedy: Remedy) -> Iterator[str]:
    """Yield the lines of a remedy: what it mends, its price, and what it changes in the model."""
    settings = ", ".join(f"{name} {mjcf_text(value)}" for name, value in remedy.settings.items())
    price = "" if remedy.time is None else f"; {_price_in_words(remedy.time)}"
    yield f"{number}. {settings} mends {', '.join(remedy.mends)}{price}"
    edits = [f"{edit.where}: {line}" for edit in remedy.edits for line in edit.lines]
    yield from (f"   {line}" for line in shortened(edits, 12, f"a patch in {MODEL}"))


def _price_in_words(ratio: float) -> str:
    """Return how much a simulated second costs with a remedy, as a ratio to its cost without."""
    shown = f"{ratio:.2g}"
    return (
        "no change in cost" if shown == "1" else f"a simulated second costs {shown} times as much"
    )


REMEDIES = "changes that help, each run on the model with those above it:"


def page(report: CheckReport) -> str:
    """Return a report as a Markdown page."""
    return "".join(f"{paragraph}\n\n" for paragraph in _paragraphs(report))


def _paragraphs(report: CheckReport) -> Iterator[str]:
    yield f"# {report.scene}: {'passes' if report.passed else 'fails'}"
    given = "".join(f" --set '{override}'" for override in report.overrides)
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
    if report.not_exercised:
        yield "## Not exercised"
        yield "\n".join(f"- {line}" for line in report.not_exercised)


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
        yield f"Evidence: {', '.join(f'`{store}`' for store in check.stores)}."


def _row(measure: Measure) -> str:
    verdict = {None: "", True: "holds", False: "**violated**"}[measure.holds]
    limit = "" if measure.limit is None else _number(measure.limit, measure.unit)
    name, of = measure.name.replace("_", " "), in_markdown(measure.of or "")
    return f"| {name} | {of} | {_number(measure.value, measure.unit)} | {limit} | {verdict} |"


def _number(value: float | None, unit: str) -> str:
    if value is None:
        return "none"
    return f"{value:.4g}" + ("" if unit == "1" else f" {unit}")
