"""A report as annotations of GitHub."""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from contactlab.judge.wording import pairs_in_words
from contactlab.printable import visible
from contactlab.schema.finding import PlacedFinding
from contactlab.writers.report import Report


def as_annotations(report: Report) -> str:
    """Return the annotations of failures and warnings, each with its worst pairs of runs."""
    errors: list[_Message] = []
    warnings: list[_Message] = []
    for finding in report.findings:
        message = f"{finding.full_name}: {finding.full_message}"
        text = _Message("\n".join([message, *pairs_in_words(finding)]))
        if isinstance(finding, PlacedFinding):
            whole = "\n".join([text.text, *finding.fix])
            text = _Message(whole, {"file": finding.file, "line": str(finding.line)})
        if finding.outcome == "warned":
            warnings.append(text)
        elif finding.outcome == "failed" or finding.is_open:
            errors.append(text)
    return _join_both_levels(report.title, errors, warnings)


def write_annotations(title: str, errors: Sequence[str], warnings: Sequence[str]) -> str:
    """Return the annotations of errors and warnings: 9 of each, and how many more."""
    return _join_both_levels(title, [*map(_Message, errors)], [*map(_Message, warnings)])


class _Message(NamedTuple):
    """The text of an annotation, and its properties, such as where it is."""

    text: str
    properties: Mapping[str, str] = {}


def _join_both_levels(title: str, errors: Sequence[_Message], warnings: Sequence[_Message]) -> str:
    lines = [
        *_list_annotations("error", title, errors),
        *_list_annotations("warning", title, warnings),
    ]
    return "".join(f"{line}\n" for line in lines)


def _list_annotations(command: str, title: str, messages: Sequence[_Message]) -> Iterator[str]:
    # A step shows ten errors and ten warnings, and silently drops the others.
    most_annotations_of_a_step = 9
    shown_messages = list(messages[:most_annotations_of_a_step])
    if len(messages) > len(shown_messages):
        shown_messages.append(
            _Message(f"and {len(messages) - len(shown_messages):,} more; see the summary")
        )
    for message in shown_messages:
        properties = {**message.properties, "title": title}
        property_list = ",".join(
            f"{name}={_escape_property(value)}" for name, value in properties.items()
        )
        yield f"::{command} {property_list}::{_escape_data(message.text)}"


def _escape_property(text: str) -> str:
    return _escape_data(text).replace(":", "%3A").replace(",", "%2C")


def _escape_data(text: str) -> str:
    return visible(text).replace("%", "%25").replace("\n", "%0A")
