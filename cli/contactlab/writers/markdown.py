"""A report as Markdown, for the summary of a job or a file, the worst first."""

from collections.abc import Iterable, Iterator, Sequence

from contactlab.judge.wording import passed_in_words
from contactlab.printable import in_markdown, in_one_line
from contactlab.schema.finding import Outcome
from contactlab.writers.report import Line, Report, Section, finding_lines

MOST_BYTES = 900_000  # a job summary of more than 1 MiB is lost
_SIGNS: dict[Outcome, str] = {
    "failed": "❌",
    "skipped": "⚪",
    "warned": "⚠️",
    "noted": "ℹ️",  # noqa: RUF001 - the sign of a note
    "passed": "✅",
}
_MOST_FIRST, _MOST_ROWS = 12, 1_000
_HEAD = ("| | check | result | worst | where |", "|---|---|---|---|---|")


def as_markdown(report: Report) -> str:
    """Return a report as Markdown of less than 0.9 MB."""
    lines: list[str] = []
    left = MOST_BYTES - 1_000
    for line in _lines(report):
        left -= len(line.encode()) + 1
        if left < 0:
            lines.append("\nThe rest is left out: a job summary holds no more.\n")
            break
        lines.append(line)
    return "\n".join(lines) + "\n"


def _lines(report: Report) -> Iterator[str]:
    yield f"### {_SIGNS['passed' if report.passed else 'failed']} {in_markdown(report.headline)}"
    yield from [""] if report.facts else []
    yield from _listed(f"{name} {text}" if name else text for name, text in report.facts)
    # Stable: within the urgent ones and the others the worst come first.
    shown = sorted(finding_lines(report), key=lambda line: not line.urgent)
    urgent = sum(line.urgent for line in shown)
    first = len(shown) if report.lists_passed else min(_MOST_FIRST, urgent)
    yield from _rows(shown[:first])
    if not report.lists_passed and (passed := passed_in_words(report.findings)):
        yield ""
        yield f"{_SIGNS['passed']} {in_markdown(passed)}"
    if rest := shown[first:]:
        yield from _folded(f"{len(rest)} more", _rows(rest))
    for section in report.sections:
        yield from _section(section)
    if report.notes:
        yield ""
        yield from _listed(report.notes)
    if report.commands:
        lines = (line for what, command in report.commands for line in (f"# {what}", command))
        yield from _folded("commands", ["", *_code("sh", lines)])


def _listed(texts: Iterable[str]) -> Iterator[str]:
    yield from (f"- {in_markdown(text)}" for text in texts)


def _rows(lines: Sequence[Line]) -> Iterator[str]:
    if not lines:
        return
    yield ""
    yield from _HEAD
    for line in lines[:_MOST_ROWS]:
        yield _row((_SIGNS[line.outcome], *map(in_markdown, line.cells)))
    if len(lines) > _MOST_ROWS:
        yield f"| | and {len(lines) - _MOST_ROWS:,} more | | | |"


def _row(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _section(section: Section) -> Iterator[str]:
    yield ""
    if section.title:
        yield f"#### {in_markdown(section.title)}"
        yield ""
    yield from _listed(section.lines)
    if section.header:
        yield ""
        yield _row(map(in_markdown, section.header))
        yield "|---" * len(section.header) + "|"
        yield from (_row(map(in_markdown, cells)) for cells in section.rows)
    if section.code:
        yield from [""] if section.lines else []
        yield from _code("", section.code)


def _code(language: str, lines: Iterable[str]) -> Iterator[str]:
    """Yield lines as code, which no line of theirs can end."""
    yield f"```{language}"
    yield from (in_one_line(line).replace("`", "'") for line in lines)
    yield "```"


def _folded(title: str, lines: Iterable[str]) -> Iterator[str]:
    yield ""
    yield f"<details><summary>{title}</summary>"
    yield from lines
    yield ""
    yield "</details>"
