"""The mistakes of a model's file, as facts beside its examination."""

from collections.abc import Iterator

from contactlab.schema.examination import Fact
from contactlab.studies.lint.linting import lint

_MOST = 3


def file_facts(reference: str) -> Iterator[Fact]:
    """Yield the first errors and warnings that lint finds in a model's files, errors first."""
    report = lint((reference,))
    found = [*report.open("error"), *report.open("warning")]
    more = len(found) - _MOST
    for number, finding in enumerate(found[:_MOST], 1):
        place = f"{finding.file}:{finding.line}"
        sentence = f"{place}: {finding.severity}: {finding.message} [{finding.name}]"
        if number == _MOST and more > 0:
            sentence += f"; contactlab lint has {more} more"
        yield Fact(kind="file", place=place, value=finding.line, unit="", sentence=sentence)
