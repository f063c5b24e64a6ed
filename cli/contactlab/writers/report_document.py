"""Describes findings with their facts, the worst first, and writes text and Markdown of them."""

from collections.abc import Iterator, Sequence

from contactlab.judge.wording import passed_in_words
from contactlab.rendering.document import (
    Block,
    Code,
    Column,
    Commands,
    Document,
    Facts,
    Headline,
    Items,
    Row,
    Sentence,
    Table,
    document_of,
    table_of,
)
from contactlab.rendering.document import Section as Part
from contactlab.rendering.markdown import render_markdown
from contactlab.rendering.text import render_text
from contactlab.writers.report import Line, Report, Section, finding_lines
from contactlab.writers.signs import ORDER, outcome_mark

MOST_BYTES = 900_000  # a job summary of more than 1 MiB is lost
_HEADS = (Column(""), Column("check"), Column("result"), Column("worst"), Column("where"))


def as_text(report: Report, width: int = 10_000) -> str:
    """Return a report as plain text of a width; by default, its lines do not wrap."""
    return f"{render_text(describe_findings(report), width)}\n"


def as_markdown(report: Report) -> str:
    """Return a report as Markdown of less than 0.9 MB."""
    lines: list[str] = []
    remaining_bytes = MOST_BYTES - 1_000
    for line in render_markdown(describe_findings(report, folded=True)).split("\n"):
        remaining_bytes -= len(line.encode()) + 1
        if remaining_bytes < 0:
            lines.append("\nThe rest is left out: a job summary holds no more.\n")
            break
        lines.append(line)
    return "\n".join(lines) + "\n"


def describe_findings(report: Report, *, folded: bool = False) -> Document:
    """Describe a report of a judge.

    Args:
        report: the findings and their facts.
        folded: whether findings after the first urgent ones are folded, as a job summary has them,
            or only the first of each outcome are listed.
    """
    mark = outcome_mark("passed" if report.passed else "failed")
    most_metrics = 6  # a quarter of a screen; files for machines list every one
    lines = finding_lines(report, None if folded else most_metrics)
    if folded:
        # Stable: within the urgent ones and the others the worst come first.
        shown_lines = sorted(lines, key=lambda line: not line.urgent)
        most_first = 12  # about a screen; the others are folded
        urgent = min(most_first, sum(line.urgent for line in shown_lines))
        first = len(shown_lines) if report.lists_passed else urgent
        findings = [Part(tuple(_table_of_lines(shown_lines[:first])), "findings")]
        if rest := shown_lines[first:]:
            table = tuple(_table_of_lines(rest))
            findings.append(Part(table, "findings", f"{len(rest)} more", folded=True))
    else:
        shown_lines = list[Line]()
        most_of_outcome = 25  # about a screen
        for outcome in ORDER:
            same = [line for line in lines if line.outcome == outcome]
            shown_lines += same[:most_of_outcome]
            if len(same) > most_of_outcome:
                more = f"and {len(same) - most_of_outcome:,} more ({outcome_mark(outcome).word})"
                shown_lines.append(Line(outcome, more))
        findings = [Part(tuple(_table_of_lines(shown_lines)), "findings")]
    if not report.lists_passed and (passed := passed_in_words(report.findings)):
        findings.insert(1, Part((Sentence(passed, outcome_mark("passed")),), follows=True))
    return document_of(
        Part((Headline(report.headline, mark),)),
        Part((Facts(report.facts),) if report.facts else ()),
        *findings,
        *map(_blocks_of_section, report.sections),
        Part(tuple(map(Sentence, report.notes))),
        Part((Commands(report.commands),) if report.commands else ()),
    )


def _table_of_lines(lines: Sequence[Line]) -> Iterator[Block]:
    if lines:
        most_rows = 1_000  # a summary of a job holds 1 MiB
        rows = tuple(Row((outcome_mark(line.outcome), *line.cells)) for line in lines[:most_rows])
        rest = len(lines) - most_rows
        more = f"and {rest:,} more" if rest > 0 else ""
        yield Table(_HEADS, rows, headed=False, more=more)


def _blocks_of_section(section: Section) -> Part:
    blocks: list[Block] = []
    if section.lines:
        blocks.append(Items(section.lines))
    if section.header:
        blocks.append(table_of(section.header, section.rows))
    if section.code:
        blocks.append(Code(section.code, indent=0))
    return Part(tuple(blocks), title=section.title)
