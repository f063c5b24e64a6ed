"""The page of a check, and its lines on the terminal."""

from collections.abc import Iterator
from itertools import chain, starmap

from contactlab.printable import in_markdown, shortened
from contactlab.schema.check_report import CheckReport, CheckResult, Measure, Remedy
from contactlab.schema.drive import drive_text
from contactlab.studies.check.check_results import mjcf_text
from contactlab.studies.check.remedies import MODEL

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
    notes = (*report.notes, STABILITY.format(model=report.model))
    yield "\n".join(f"- {note}" for note in notes)
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
