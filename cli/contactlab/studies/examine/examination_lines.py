"""An examination as lines of text for 80 columns."""

from collections.abc import Iterator

from contactlab.budget.text import (
    UNIT,
    Placed,
    never_lines,
    phase_lines,
    share_text,
    table_lines,
)
from contactlab.printable import percent, visible, wrapped
from contactlab.reporting.examination import (
    change_line,
    contact_lines,
    largest_rows,
    phase_begins,
    row_size,
    untried_line,
)
from contactlab.schema.drive import PolicyDrive
from contactlab.schema.error_budget import BudgetRemedy
from contactlab.schema.examination import Examination, ModelChange

_TOLD = 0.1  # of the tolerance: rows that a short table has
_MOST_LINES = 6  # of a change
_REPLAYED = "What the policy did is replayed; whether its loop is stable is not judged."


def examination_lines(report: Examination, *, full: bool = False) -> list[str]:
    """Return the verdict, the task, and the sections that were asked for.

    In short, rows of the budget are those of the phase in which each is largest, above a tenth of
    the tolerance, and checks those that do not pass; in full, all rows of each phase, all changes
    that were tried, all checks, and the contacts in units of the world.
    """
    alone = len(report.sections) == 1
    lines = [*wrapped(report.sentence, ""), *wrapped(report.task.line, "")]
    if isinstance(report.task.drive, PolicyDrive):
        lines += wrapped(_REPLAYED, "")
    if "budget" in report.sections:
        lines += ["", *(_full_budget(report) if full else budget_table(report))]
    parts = [
        [line for fact in report.facts for line in wrapped(fact.sentence, "")],
        list(_labels(report)),
        list(_checks(report, every=full or alone)),
        [line for contact in report.contacts for line in contact_lines(contact)]
        if full or alone
        else [],
        *(list(_change(number, change)) for number, change in enumerate(report.changes, 1)),
        wrapped(untried_line(report), ""),
        [line for note in report.notes for line in wrapped(note, "")] if full or alone else [],
        [line for end in _ends(report) for line in wrapped(end, "")],
    ]
    for part in filter(None, parts):
        lines += ["", *part]
    return [visible(line) for line in lines]


def _full_budget(report: Examination) -> Iterator[str]:
    yield from wrapped(UNIT, "")
    begins = phase_begins(report.task)
    for phase in report.budget.phases if report.budget else ():
        yield from ("", *phase_lines(phase, begins.get(phase.name, 0.0)))
    yield from _tried(report)


def _labels(report: Examination) -> Iterator[str]:
    """Yield the labels of the runs; in the section alone, the numerics of each phase too."""
    if report.verdict is None:
        return
    if report.sections == ("labels",):
        for phase in report.verdict.phases:
            held = ", ".join(f"{name} {runs}" for name, runs in phase.labels.items()) or "stable"
            moved = f"{share_text(phase.share)} in {phase.body}" if phase.body else "not measured"
            yield from wrapped(f"{phase.name}: {held}; phantom forces {moved}", "")
    for label in report.labels:
        yield from wrapped(f"{label.label}{label.where}: {label.reason}, {_runs(label.runs)}", "")


def _runs(count: int) -> str:
    return f"in {count} run{'s' * (count != 1)}"


def _checks(report: Examination, *, every: bool) -> Iterator[str]:
    for finding in report.findings:
        if every or finding.outcome in {"failed", "warned"}:
            word = {"failed": "FAIL", "warned": "WARN", "passed": "pass", "skipped": "skip"}
            yield from wrapped(f"{word.get(finding.outcome, 'note')} {finding.full_message}", "")
    for check in report.checks:
        if every or check.verdict == "fail":
            yield from (
                line for note in check.notes for line in wrapped(f"{check.name}: {note}", "  ")
            )


def budget_table(report: Examination) -> Iterator[str]:
    """Yield the run, and the rows that matter, each from the phase in which it is largest."""
    if report.budget is None:
        return
    found = largest_rows(report.budget, report.task)
    run = Placed(*found.pop(report.budget.phases[0].run.name))
    least = _TOLD * report.budget.within
    shown = {name: Placed(*at) for name, at in found.items() if row_size(at[0]) >= least}
    yield from table_lines(run, list(shown.values()))
    if less := [name for name in found if name not in shown]:
        yield from wrapped(f"below {percent(least)}: {', '.join(less)}", "")
    idle = {row.name: None for phase in report.budget.phases for row in phase.rows}
    yield from never_lines([name for name in idle if name not in found])


def _change(number: int, change: ModelChange) -> Iterator[str]:
    yield from wrapped(change_line(number, change), "")
    yield from (f"   {line}" for line in change.lines[:_MOST_LINES])
    if len(change.lines) > _MOST_LINES:
        yield f"   and {len(change.lines) - _MOST_LINES} more lines, which --write writes"
    if change.unwritten:
        yield from wrapped(f"not written: {change.unwritten}", "   ")


def _ends(report: Examination) -> Iterator[str]:
    """Yield what comes next: the changed model, the page, and the evidence."""
    budget = report.budget
    if report.written:
        yield f"the model with the changes: {report.written}"
    elif any(change.lines for change in report.changes):
        physics = all(change.physics for change in report.changes)
        named = " that --accept names" if physics else ""
        yield f"changes were judged on fresh seeds too; --write FILE writes the first{named}"
    elif "changes" in report.sections and budget and budget.remedies and not report.changes:
        names = ", ".join(remedy.name for remedy in budget.remedies)
        yield f"no change that was tried removes it: {names}"
    elif "budget" in report.sections:
        yield "--format full prints all rows of each phase"
    if report.page:
        yield f"page: {report.page}"
    elif report.evidence:
        yield f"evidence: {report.evidence}"


def _tried(report: Examination) -> Iterator[str]:
    if report.budget and report.budget.remedies:
        yield ""
        yield f"{'changes tried:':45} {'cost':>6} {'share':>7}"
        yield from map(_remedy, report.budget.remedies)


def _remedy(remedy: BudgetRemedy) -> str:
    cost = f"x{remedy.price.ratio:.2f}" if remedy.price else ""
    end = "removes it" if remedy.removes else f"still {remedy.word}"
    share = "∞" if remedy.share is None else percent(remedy.share)
    return f"  {remedy.name:43} {cost:>6} {share:>7}  {end}"
