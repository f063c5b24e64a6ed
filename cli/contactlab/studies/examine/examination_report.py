"""An examination as what writers write: findings, sections, and what was judged."""

from collections.abc import Iterator

from contactlab.reporting.examination import change_line, contact_lines, untried_line
from contactlab.schema.examination import Examination, ModelChange
from contactlab.studies.check.check_results import check_section
from contactlab.studies.examine.examination_lines import budget_table
from contactlab.writers.report import Report, Section


def report_of(report: Examination) -> Report:
    """Return what is written of an examination, in the sections that were asked for."""
    facts = [("task", report.task.line)]
    if report.verdict is not None:
        facts.append(("verdict", report.verdict.line))
    facts.append(("engine", f"mujoco {report.mujoco}"))
    ends = {"page": report.page, "changed model": report.written, "evidence": report.evidence}
    return Report(
        title=f"contactlab examine {report.model}",
        place=(report.model,),
        headline=f"{report.model}: {report.sentence}",
        passed=report.sound,
        record=report,
        facts=(*facts, *((name, path) for name, path in ends.items() if path)),
        findings=report.findings,
        sections=tuple(_sections(report)),
        notes=(*filter(None, (untried_line(report),)), *report.notes),
    )


def _sections(report: Examination) -> Iterator[Section]:
    if report.budget is not None and "budget" in report.sections:
        yield Section("error budget", code=tuple(budget_table(report)))
    if report.facts:
        yield Section("facts", tuple(fact.sentence for fact in report.facts))
    for number, change in enumerate(report.changes, 1):
        yield _change(number, change)
    yield from map(check_section, report.checks)
    if report.contacts:
        lines = (line for contact in report.contacts for line in contact_lines(contact))
        yield Section("contacts at rest and in an impact", code=tuple(lines))


def _change(number: int, change: ModelChange) -> Section:
    return Section(change_line(number, change), code=change.lines)
