"""The page of a check, and its lines on the terminal."""

from collections.abc import Iterator

from contactlab.printable import in_markdown
from contactlab.schema.check_report import CheckReport, CheckResult, Measure, Remedy
from contactlab.schema.drive import drive_text
from contactlab.studies.check.check_results import mjcf_text

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
    """Yield the lines of a remedy: what it mends, its price, and where its MJCF belongs."""
    settings = ", ".join(f"{name} {mjcf_text(value)}" for name, value in remedy.settings.items())
    price = "" if remedy.time is None else f"; steps take {remedy.time:.2g} times as long"
    yield f"{number}. {settings} mends {', '.join(remedy.mends)}{price}"
    for edit in remedy.edits:
        yield f"   {edit.where}:"
        yield from (f"     {line}" for line in edit.lines)


REMEDIES = "changes that help, each run on the model with those above it:"


def page(report: CheckReport) -> str:
    """Return a report as a Markdown page."""
    parts = (_head(report), _overview(report), _remedies(report), _checks(report))
    return "\n".join(line for part in parts for line in part) + "\n"


def _head(report: CheckReport) -> Iterator[str]:
    yield f"# {report.scene}: {'passes' if report.passed else 'fails'}"
    yield ""
    given = "".join(f" --set '{each}'" for each in report.overrides)
    yield f"    contactlab check {report.model}{given}"
    yield ""
    yield (
        f"Model `{report.model}` ({report.scene_hash}), {conditions(report)}; "
        f"{report.engine.name} {report.engine.version}."
    )
    yield ""


def conditions(report: CheckReport) -> str:
    """Return in words where runs start, what drives them, and the kind of task."""
    start = f"keyframe {report.keyframe}" if report.keyframe else "its initial state"
    drive = drive_text(report.drive)
    driven = "driven by nothing" if drive == "none" else f"driven by {drive}"
    return f"from {start}, {driven}, for {report.kind} ({report.kind_reason})"


def _overview(report: CheckReport) -> Iterator[str]:
    yield "| | finding | result |"
    yield "|---|---|---|"
    for verdict, name, message in summary_rows(report):
        yield f"| {verdict} | {name} | {in_markdown(message)} |"
    yield ""
    yield from (f"- {note}" for note in report.notes)
    yield f"- {STABILITY.format(model=report.model)}"
    yield ""


def _remedies(report: CheckReport) -> Iterator[str]:
    if report.remedies:
        yield "## Remedies"
        yield ""
        yield f"{REMEDIES.capitalize()}"
        yield ""
        yield "```"
        for number, remedy in enumerate(report.remedies, 1):
            yield from remedy_lines(number, remedy)
        yield "```"
        yield ""


def _checks(report: CheckReport) -> Iterator[str]:
    for each in report.checks:
        yield from _check(each)


def _check(check: CheckResult) -> Iterator[str]:
    yield f"## {check.name}: {check.verdict}"
    yield ""
    yield f"Criterion: {check.asks}."
    yield ""
    yield f"{check.reason[:1].upper()}{check.reason[1:]}."
    yield ""
    if check.measures:
        yield from _measures(check.measures)
    for note in check.notes:
        yield f"- {note}"
    if check.notes:
        yield ""
    if check.stores:
        yield f"Evidence: {', '.join(f'`{each}`' for each in check.stores)}."
        yield ""


def _measures(measures: tuple[Measure, ...]) -> Iterator[str]:
    yield "| number | of | value | limit | |"
    yield "|---|---|---|---|---|"
    for each in measures:
        verdict = "" if each.holds is None else "holds" if each.holds else "**violated**"
        limit = "" if each.limit is None else _number(each.limit, each.unit)
        name, of = each.name.replace("_", " "), in_markdown(each.of or "")
        yield f"| {name} | {of} | {_number(each.value, each.unit)} | {limit} | {verdict} |"
    yield ""


def _number(value: float | None, unit: str) -> str:
    if value is None:
        return "none"
    return f"{value:.4g}" + ("" if unit == "1" else f" {unit}")
