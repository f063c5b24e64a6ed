"""A report as plain text, the worst first."""

import textwrap
from collections.abc import Iterator, Sequence

from contactlab.judge.wording import passed_in_words
from contactlab.printable import in_one_line, printable
from contactlab.schema.finding import Outcome
from contactlab.writers.report import Line, Report, Section, finding_lines

WIDEST = 10_000  # lines of a file or a pipe: they do not wrap
OUTCOME_WORDS: dict[Outcome, str] = {
    "failed": "FAIL",
    "skipped": "SKIP",
    "warned": "WARN",
    "noted": "note",
    "passed": "ok",
}
_MOST_OF_OUTCOME, _WIDEST_CELL, _MOST_INDENT = 25, 60, 30


def as_text(report: Report, width: int = WIDEST) -> str:
    """Return a report as plain text; sentences wrap between words at a width."""
    return "\n".join(line.rstrip() for line in _lines(report, width)) + "\n"


def _lines(report: Report, width: int) -> Iterator[str]:
    yield _filled(report.headline, width)
    if report.facts:
        yield ""
        longest = max(len(name) for name, _ in report.facts)
        yield from (in_one_line(f"  {name:{longest}}  {text}") for name, text in report.facts)
    if report.findings:
        yield ""
        yield from _findings(finding_lines(report), width)
        if not report.lists_passed and (passed := passed_in_words(report.findings)):
            yield in_one_line(f"{OUTCOME_WORDS['passed']:4}  {passed}")
    for section in report.sections:
        yield ""
        yield from map(in_one_line, _section(section))
    if report.notes:
        yield ""
        yield from (_filled(note, width) for note in report.notes)
    if report.command_lines:
        yield ""
        yield from map(in_one_line, report.command_lines)


def _findings(lines: Sequence[Line], width: int) -> Iterator[str]:
    shown: list[Line] = []
    for outcome, word in OUTCOME_WORDS.items():
        same = [line for line in lines if line.outcome == outcome]
        shown += same[:_MOST_OF_OUTCOME]
        if len(same) > _MOST_OF_OUTCOME:
            shown.append(Line(outcome, f"and {len(same) - _MOST_OF_OUTCOME:,} more ({word})"))
    names, messages, worst = (
        min(max((len(line.cells[column]) for line in shown), default=0), _WIDEST_CELL)
        for column in range(3)
    )
    for line in shown:
        start = in_one_line(f"{OUTCOME_WORDS[line.outcome]:4}  {line.name:{names}}  ")
        rest = in_one_line(f"{line.message:{messages}}  {line.worst:{worst}}  {line.where}")
        whole = (start + rest).rstrip()
        yield whole if len(whole) <= width else _wrapped(start, rest, width)


def _filled(text: str, width: int) -> str:
    """Return a sentence, wrapped between words where it is longer than the width."""
    line = in_one_line(text)
    return line if len(line) <= width else _wrapped("", line, width)


def _wrapped(start: str, rest: str, width: int) -> str:
    """Return a line that wraps between words; further lines are indented."""
    indent = " " * min(len(start), _MOST_INDENT)
    words = " ".join(rest.split())
    lines = textwrap.fill(
        words,
        width,
        initial_indent=start,
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    )
    # A word that now begins a line may be a command there.
    return printable(lines)


def _section(section: Section) -> Iterator[str]:
    yield from filter(None, (section.title, *section.lines))
    rows = [section.header, *section.rows] if section.header else []
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for cells in rows:
        yield "  ".join(f"{cell:{width}}" for cell, width in zip(cells, widths, strict=True))
    yield from section.code
