"""A comparison as GitHub annotations: lines that a job prints."""

from collections.abc import Iterator, Sequence

from contactlab.compare.told import Line, told
from contactlab.schema import ComparisonReport

_MOST = 9
"""A step shows ten errors and ten warnings; what is beyond is dropped without a word."""


def as_annotations(report: ComparisonReport) -> str:
    """Return the annotations of failed and warned checks: 9 of each, and how many more."""
    if report.baseline is None or report.candidate is None:
        return _annotation("error", "contactlab compare", report.headline) + "\n"
    title = f"contactlab {report.candidate.sweep}"
    urgent = [line for line in told(report) if line.urgent]
    errors = [line for line in urgent if line.outcome != "warned"]
    warnings = [line for line in urgent if line.outcome == "warned"]
    found = [*_annotations("error", title, errors), *_annotations("warning", title, warnings)]
    return "".join(f"{line}\n" for line in found)


def _annotations(command: str, title: str, lines: Sequence[Line]) -> Iterator[str]:
    for line in lines[:_MOST]:
        where = f" ({line.worst} at {line.where})" if line.worst else ""
        yield _annotation(command, title, f"{line.name}: {line.found}{where}")
    if len(lines) > _MOST:
        yield _annotation(command, title, f"and {len(lines) - _MOST:,} more; see the summary")


def _annotation(command: str, title: str, message: str) -> str:
    return f"::{command} title={_property(title)}::{_data(message)}"


def _data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    return _data(text).replace(":", "%3A").replace(",", "%2C")
