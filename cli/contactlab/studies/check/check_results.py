"""The results of checks and their findings, and how they and changes that help are written.

A gate is what a run of the model itself shows to be wrong, or what no physical body can be; a
warning is a rule of thumb of people who simulate contact with MuJoCo.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from contactlab.judge.limits import exceeding, in_words, limit_findings, limited, worst_of
from contactlab.printable import first_names, shortened
from contactlab.schema.check_report import CheckReport, CheckResult, CheckVerdict, Measure, Remedy
from contactlab.schema.drive import drive_text
from contactlab.schema.finding import Finding, Level
from contactlab.store.table_layout import as_written
from contactlab.writers.report import Report, Section

# What it means for a check that a limit of some level is exceeded, the worst first.
_VERDICTS: Mapping[Level, CheckVerdict] = {"gate": "fail", "warn": "warning", "note": "pass"}


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
        levels = {measure.level for measure in exceeding(measures)}
        worst: list[CheckVerdict] = [word for level, word in _VERDICTS.items() if level in levels]
        verdict = worst[0] if worst else "pass"
        told = sorted(limited(measures), key=lambda group: not exceeding(group))
        reason = "; ".join(in_words(worst_of(group)) for group in told)
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
            kind=result.name,
            level="note",
            outcome="skipped",
            verdict="not applicable",
            judged=0,
            failing=0,
            message=result.reason,
        )
    yield from limit_findings(result.name, result.measures)


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


REMEDIES = "changes that help, each run on the model with those above it"
_MOST_NOTES = 4  # of a check, in the short report


def report_of(report: CheckReport, page: Path | None = None) -> Report:
    """Return a check of a model as what is written of it.

    With a page, which has all of it: without the numbers of each check, and with its name.
    """
    verdict = "passes" if report.passed else "fails"
    given = "".join(f" --set '{override}'" for override in report.overrides)
    notes = [*report.notes, *map(first_names, report.not_exercised)]
    notes.append(STABILITY.format(model=report.model))
    notes += [] if page is None else [f"all numbers and evidence are in {page}"]
    remedies = _remedies(report)
    return Report(
        title=f"contactlab check {report.scene}",
        place=(report.scene,),
        headline=f"{report.model} {verdict}",
        passed=report.passed,
        record=report,
        facts=(
            ("task", report.task.line),
            *((("verdict", report.verdict.line),) if report.verdict is not None else ()),
            ("model", f"{report.scene}, {conditions(report)}"),
            ("scene", report.scene_hash),
            ("engine", f"{report.engine.name} {report.engine.version}"),
            ("command", f"contactlab check {report.model}{given}"),
        ),
        findings=report.findings,
        sections=(*_check_sections(report, page), *remedies),
        notes=tuple(notes),
    )


def _check_sections(report: CheckReport, page: Path | None) -> Iterator[Section]:
    """Yield a section for each check: all of it, or beside a page its first notes."""
    for check in report.checks:
        if page is None:
            yield _check(check)
        elif check.notes:
            yield Section("", tuple(f"{check.name}: {note}" for note in _first(check.notes, page)))


def _first(notes: Sequence[str], page: Path) -> list[str]:
    return shortened(notes, _MOST_NOTES, page.name)


def _remedies(report: CheckReport) -> Iterator[Section]:
    lines = (
        line
        for number, remedy in enumerate(report.remedies, 1)
        for line in remedy_lines(number, remedy)
    )
    if report.remedies:
        yield Section(REMEDIES, code=tuple(lines))


def conditions(report: CheckReport) -> str:
    """Return in words where runs start, what drives them, and the kind of task."""
    start = f"keyframe {report.keyframe}" if report.keyframe else "its initial state"
    drive = drive_text(report.drive)
    driven = "driven by nothing" if drive == "none" else f"driven by {drive}"
    return f"from {start}, {driven}, for {report.kind} ({report.kind_reason})"


def _check(check: CheckResult) -> Section:
    lines = [f"criterion: {check.asks}", check.reason, *check.notes]
    if check.stores:
        lines.append(f"evidence: {', '.join(check.stores)}")
    return Section(
        f"{check.name}: {check.verdict}",
        tuple(filter(None, lines)),
        ("number", "of", "value", "limit", "") if check.measures else (),
        tuple(map(_row, check.measures)),
    )


def _row(measure: Measure) -> tuple[str, ...]:
    verdict = {None: "", True: "holds", False: "exceeded"}[measure.holds]
    limit = "" if measure.limit is None else _number(measure.limit, measure.unit)
    value = _number(measure.value, measure.unit)
    return measure.name.replace("_", " "), measure.of or "", value, limit, verdict


def _number(value: float | None, unit: str) -> str:
    if value is None:
        return "none"
    return f"{value:.4g}" + ("" if unit == "1" else f" {unit}")
