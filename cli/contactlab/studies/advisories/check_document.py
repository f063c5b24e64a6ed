"""Describes a check of advisories: a row for each, a column for each release."""

from contactlab.rendering.document import (
    Column,
    Document,
    Headline,
    Mark,
    Row,
    Sentence,
    Table,
    document_of,
)
from contactlab.schema.advisory_report import AdvisoriesCheck, WitnessResult

_SIGNS = {"shown": "x", "crashed": "x", "not shown": ".", "unclear": "?", "not run": "-"}


def describe_check(report: AdvisoriesCheck) -> Document:
    """Describe the releases that show the fault of each witness."""
    rows = list[Row]()
    for name in dict.fromkeys(result.advisory for result in report.results):
        results = [result for result in report.results if result.advisory == name]
        rows.append(Row((name, *(_sign_of(result) for result in results))))
    columns = (Column("advisory"), *(Column(release) for release in report.releases))
    legend = "x: the witness shows the fault; .: the right value; -: not run; !: not as written"
    mark = Mark("failed" if report.problem else "passed")
    return document_of(
        [Headline(report.headline, mark), Table(columns, tuple(rows)), Sentence(legend)]
    )


def _sign_of(result: WitnessResult) -> str:
    return _SIGNS[result.outcome] + ("!" if result.mistake else "")
