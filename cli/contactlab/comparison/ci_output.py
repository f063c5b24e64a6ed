"""A comparison for CI jobs: Markdown, GitHub annotations and JUnit XML."""

import re
from collections.abc import Iterator, Sequence
from xml.etree import ElementTree as ET

from contactlab.comparison.report_lines import (
    WORDS,
    ReportLine,
    check_message,
    check_name,
    label_changes,
    pair_location,
    pair_values,
    passed_summary,
    report_lines,
    run_summary,
    store_summary,
)
from contactlab.schema.comparison_report import Check, ComparisonReport

MOST_BYTES = 900_000
"""A job summary of more than 1 MiB is lost."""
_MOST_FIRST = 12
_MOST_LINES = 1_000
_SIGNS = {"failed": "❌", "skipped": "⚪", "warned": "⚠️", "noted": "ℹ️", "passed": "✅"}  # noqa: RUF001
assert set(_SIGNS) == set(WORDS)
_HEAD = ("| | check | result | worst | where |", "|---|---|---|---|---|")
_MOST_ANNOTATIONS = 9
"""A step shows ten errors and ten warnings, and silently drops the others."""
# XML cannot represent these characters, not even escaped.
_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


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
    yield f"### {sign} {_escaped(report.headline)}"
    if report.baseline is None or report.candidate is None:
        return
    yield ""
    yield f"- baseline {_escaped(store_summary(report.baseline))}"
    yield f"- candidate {_escaped(store_summary(report.candidate))}"
    yield f"- runs: {_escaped(run_summary(report))}"
    if label_changes(report):
        yield f"- labels: {_escaped(', '.join(label_changes(report)))}"
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
        cells = (_SIGNS[line.outcome], *(_escaped(cell) for cell in line[1:5]))
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
        yield f"# {what}"
        yield command


def _escaped(text: str) -> str:
    """Return text that Markdown shows as it is, in one cell of a table."""
    plain = " ".join(text.split()).replace("\\", "\\\\")
    for sign in "|`*_<>[]#~$":
        plain = plain.replace(sign, f"\\{sign}")
    return plain


def as_annotations(report: ComparisonReport) -> str:
    """Return the annotations of errors and warnings: 9 of each, and how many more."""
    if report.baseline is None or report.candidate is None:
        return _annotation("error", "contactlab compare", report.headline) + "\n"
    title = f"contactlab {report.candidate.sweep}"
    urgent = [line for line in report_lines(report) if line.urgent]
    errors = [line for line in urgent if line.outcome != "warned"]
    warnings = [line for line in urgent if line.outcome == "warned"]
    lines = [*_annotations("error", title, errors), *_annotations("warning", title, warnings)]
    return "".join(f"{line}\n" for line in lines)


def _annotations(command: str, title: str, lines: Sequence[ReportLine]) -> Iterator[str]:
    for line in lines[:_MOST_ANNOTATIONS]:
        where = f" ({line.worst} at {line.where})" if line.worst else ""
        yield _annotation(command, title, f"{line.name}: {line.message}{where}")
    if len(lines) > _MOST_ANNOTATIONS:
        yield _annotation(
            command, title, f"and {len(lines) - _MOST_ANNOTATIONS:,} more; see the summary"
        )


def _annotation(command: str, title: str, message: str) -> str:
    return f"::{command} title={_property(title)}::{_data(message)}"


def _data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    return _data(text).replace(":", "%3A").replace(",", "%2C")


def as_junit(report: ComparisonReport) -> str:
    """Return a comparison as JUnit XML.

    Warnings and notes are passed cases with a `system-out`; what cannot be compared is a skipped
    case.
    """
    sweep = "stores" if report.baseline is None else report.baseline.sweep
    outcomes = [check.outcome for check in report.checks]
    root = ET.Element("testsuites")
    suite = ET.SubElement(
        root,
        "testsuite",
        name=_clean(f"contactlab compare {sweep}"),
        tests=str(len(outcomes)),
        failures=str(outcomes.count("failed")),
        errors="0",
        skipped=str(outcomes.count("skipped")),
        time="0",
    )
    suite.extend(_case(check, sweep, report.advice) for check in report.checks)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _case(check: Check, sweep: str, advice: Sequence[str]) -> ET.Element:
    # Readers split the class name at its dots.
    parts = ("contactlab", sweep, check.kind, *filter(None, [check.group]))
    case = ET.Element(
        "testcase",
        name=_clean(check.name),
        classname=_clean(".".join(part.replace(".", "_") for part in parts)),
        time="0",
    )
    message = _clean(f"{check.verdict}: {check_message(check)}")
    if check.outcome == "failed":
        failure = ET.SubElement(case, "failure", message=message, type=check.verdict)
        failure.text = _clean("\n".join([message, *_pairs(check), *advice]))
    elif check.outcome == "skipped":
        ET.SubElement(case, "skipped", message=message)
    elif check.outcome != "passed":
        output = "\n".join([f"{check.outcome}: {message}", *_pairs(check)])
        ET.SubElement(case, "system-out").text = _clean(output)
    return case


def _pairs(check: Check) -> list[str]:
    name = check_name(check)
    pairs = [(pair_values(check, pair), pair_location(pair)) for pair in check.worst]
    return [f"{name}: {f'{values} ' if values else ''}at {where}" for values, where in pairs]


def _clean(text: str) -> str:
    return _FORBIDDEN.sub("?", text)
