"""A comparison for CI jobs: Markdown, GitHub annotations and JUnit XML."""

from collections.abc import Iterator, Sequence

from contactlab.ci_output import JUnitCase, annotations, junit
from contactlab.comparison.report_lines import (
    WORDS,
    ReportLine,
    label_changes,
    pair_location,
    pair_values,
    passed_summary,
    report_lines,
    run_summary,
    store_summary,
)
from contactlab.printable import in_markdown, in_one_line
from contactlab.schema.comparison_report import Check, ComparisonReport

MOST_BYTES = 900_000
"""A job summary of more than 1 MiB is lost."""
_MOST_FIRST = 12
_MOST_LINES = 1_000
_SIGNS = {"failed": "❌", "skipped": "⚪", "warned": "⚠️", "noted": "ℹ️", "passed": "✅"}  # noqa: RUF001
assert set(_SIGNS) == set(WORDS)
_HEAD = ("| | check | result | worst | where |", "|---|---|---|---|---|")


def as_markdown(report: ComparisonReport) -> str:
    """Return a comparison as Markdown of less than 0.9 MB, the worst first."""
    lines: list[str] = []
    left = MOST_BYTES - 1_000
    for line in _lines(report):
        left -= len(line.encode()) + 1
        if left < 0:
            lines.append("\nThe rest is left out: a job summary holds no more.\n")
            break
        lines.append(line)
    return "\n".join(lines) + "\n"


def _lines(report: ComparisonReport) -> Iterator[str]:
    sign = _SIGNS["passed" if report.exit_code == 0 else "failed"]
    yield f"### {sign} {in_markdown(report.headline)}"
    if report.baseline is None or report.candidate is None:
        return
    yield ""
    yield f"- baseline {in_markdown(store_summary(report.baseline))}"
    yield f"- candidate {in_markdown(store_summary(report.candidate))}"
    yield f"- runs: {in_markdown(run_summary(report))}"
    if label_changes(report):
        yield f"- labels: {in_markdown(', '.join(label_changes(report)))}"
    shown = report_lines(report)
    urgent = [line for line in shown if line.urgent]
    first = urgent[:_MOST_FIRST]
    rest = [*urgent[_MOST_FIRST:], *(line for line in shown if not line.urgent)]
    yield from _table(first)
    yield ""
    yield f"{_SIGNS['passed']} {passed_summary(report)}"
    yield from _folded(f"{len(rest)} more", list(_table(rest))) if rest else ()
    advice = ["", "```sh", *(line.replace("`", "'") for line in _commands(report.advice)), "```"]
    yield from _folded("commands", advice) if report.advice else ()


def _table(lines: Sequence[ReportLine]) -> Iterator[str]:
    if not lines:
        return
    yield ""
    yield from _HEAD
    for line in lines[:_MOST_LINES]:
        cells = (_SIGNS[line.outcome], *(in_markdown(cell) for cell in line[1:5]))
        yield f"| {' | '.join(cells)} |"
    if len(lines) > _MOST_LINES:
        yield f"| | and {len(lines) - _MOST_LINES:,} more | | | |"


def _folded(title: str, lines: Sequence[str]) -> Iterator[str]:
    yield ""
    yield f"<details><summary>{title}</summary>"
    yield from lines
    yield ""
    yield "</details>"


def _commands(advice: Sequence[str]) -> Iterator[str]:
    for each in advice:
        what, _, command = each.partition(": ")
        yield in_one_line(f"# {what}")
        yield in_one_line(command)


def as_annotations(report: ComparisonReport) -> str:
    """Return the annotations of errors and warnings: 9 of each, and how many more."""
    if report.baseline is None or report.candidate is None:
        return annotations("contactlab compare", [report.headline], [])
    urgent = [line for line in report_lines(report) if line.urgent]
    return annotations(
        f"contactlab {report.candidate.sweep}",
        [_message(line) for line in urgent if line.outcome != "warned"],
        [_message(line) for line in urgent if line.outcome == "warned"],
    )


def _message(line: ReportLine) -> str:
    where = f" ({line.worst} at {line.where})" if line.worst else ""
    return f"{line.name}: {line.message}{where}"


def as_junit(report: ComparisonReport) -> str:
    """Return a comparison as JUnit XML; what cannot be compared is a skipped case."""
    sweep = "stores" if report.baseline is None else report.baseline.sweep
    return junit(
        f"contactlab compare {sweep}",
        [
            JUnitCase(
                check,
                (sweep, check.kind, check.group),
                check.verdict,
                [*_pairs(check), *(report.advice if check.outcome == "failed" else ())],
            )
            for check in report.checks
        ],
    )


def _pairs(check: Check) -> list[str]:
    pairs = [(pair_values(check, pair), pair_location(pair)) for pair in check.worst]
    return [
        f"{check.full_name}: {f'{values} ' if values else ''}at {where}" for values, where in pairs
    ]
