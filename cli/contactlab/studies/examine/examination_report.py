"""Converts an examination to a report of the writers: facts, findings and sections."""

from collections.abc import Iterator

from contactlab.reporting.examination import (
    contact_lines,
    fix_summary,
    not_tried_line,
)
from contactlab.schema.examination import Examination
from contactlab.studies.check.check_results import check_section
from contactlab.studies.examine.examination_lines import budget_table, told_facts
from contactlab.writers.report import Report, Section


def report_of(report: Examination) -> Report:
    """Return the report of an examination, with the requested sections."""
    facts = [("why", cause) for cause in report.why]
    if report.fix:
        facts.append(("fix", report.fix))
    facts.append(("task", report.task.line))
    if report.task_verdict is not None:
        facts.append(("verdict", report.task_verdict.line))
    facts.append(("engine", f"mujoco {report.mujoco}"))
    ends = {"page": report.page, "fixed model": report.written, "evidence": report.evidence}
    return Report(
        title=f"contactlab examine {report.model}",
        place=(report.model,),
        headline=f"{report.model}: {report.headline}",
        passed=report.passed,
        record=report,
        facts=(*facts, *((name, path) for name, path in ends.items() if path)),
        findings=report.findings,
        sections=tuple(_sections(report)),
        notes=(*filter(None, (not_tried_line(report),)), *report.notes),
    )


def _sections(report: Examination) -> Iterator[Section]:
    for number, fix in enumerate(report.fixes, 1):
        yield Section(f"fix {number}: {fix_summary(fix, report)}", code=fix.lines)
    if report.budget is not None and "budget" in report.sections:
        yield Section("error budget", code=tuple(budget_table(report)))
    if facts := told_facts(report):
        yield Section("facts", tuple(facts))
    yield from map(check_section, report.checks)
    if report.contacts:
        lines = (line for contact in report.contacts for line in contact_lines(contact))
        yield Section("contacts at rest and in an impact", code=tuple(lines))
