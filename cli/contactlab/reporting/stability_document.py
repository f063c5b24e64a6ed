"""Describes the results of hard cases."""

from contactlab.printable import shorten_lines
from contactlab.rendering.amounts import format_amount
from contactlab.rendering.document import Document, Sentence, document_of, table_of
from contactlab.schema.check_report import StabilityReport, StabilityResult

_HEADS = ("case", "runs", "as expected", "controls", "labels", "error", "step", "seconds")


def describe_stability(report: StabilityReport) -> Document:
    """Describe hard cases: a row for each, and its unmet expectations."""
    seconds = format_amount(sum(case.seconds for case in report.cases), "s")
    passed_count = sum(case.passed for case in report.cases)
    most_misses = 5  # of a case
    missed = [
        f"{case.name} {miss}"
        for case in report.cases
        for miss in shorten_lines(case.misses, most_misses, case.store)
    ]
    return document_of(
        [
            table_of(_HEADS, [_case_row(case) for case in report.cases]),
            *map(Sentence, missed),
            Sentence(f"{passed_count} of {len(report.cases)} cases are as expected, in {seconds}"),
        ]
    )


def _case_row(case: StabilityResult) -> tuple[object, ...]:
    labels = ", ".join(f"{label} {count}" for label, count in case.labels.items())
    passed_text = f"{case.as_expected}/{case.expected}"
    end = (case.error, case.step, case.seconds)
    return case.name, case.runs, passed_text, case.controls, labels, *end
