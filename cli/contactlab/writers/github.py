"""A report as annotations of GitHub."""

from collections.abc import Iterator, Sequence

from contactlab.judge.wording import pairs_in_words
from contactlab.printable import visible
from contactlab.writers.report import Report

# A step shows ten errors and ten warnings, and silently drops the others.
_MOST_ANNOTATIONS_OF_A_STEP = 9


def as_annotations(report: Report) -> str:
    """Return the annotations of failures and warnings, each with its worst pairs of runs."""
    errors: list[str] = []
    warnings: list[str] = []
    for finding in report.findings:
        message = f"{finding.full_name}: {finding.full_message}"
        text = "\n".join([message, *pairs_in_words(finding)])
        if finding.outcome == "warned":
            warnings.append(text)
        elif finding.outcome == "failed" or finding.is_open:
            errors.append(text)
    return annotations(report.title, errors, warnings)


def annotations(title: str, errors: Sequence[str], warnings: Sequence[str]) -> str:
    """Return the annotations of errors and warnings: 9 of each, and how many more."""
    lines = [*_annotations("error", title, errors), *_annotations("warning", title, warnings)]
    return "".join(f"{line}\n" for line in lines)


def _annotations(command: str, title: str, messages: Sequence[str]) -> Iterator[str]:
    shown = list(messages[:_MOST_ANNOTATIONS_OF_A_STEP])
    if len(messages) > len(shown):
        shown.append(f"and {len(messages) - len(shown):,} more; see the summary")
    titled = _data(title).replace(":", "%3A").replace(",", "%2C")
    for message in shown:
        yield f"::{command} title={titled}::{_data(message)}"


def _data(text: str) -> str:
    return visible(text).replace("%", "%25").replace("\n", "%0A")
