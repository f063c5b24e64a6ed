"""Writes an examination as lines of text for 80 columns."""

import textwrap
from collections.abc import Iterator, Sequence

from contactlab.budget.text import (
    DEFINITION,
    NOTES,
    Placed,
    phase_lines,
    share_text,
    table_lines,
    unexercised_lines,
)
from contactlab.printable import COLUMNS, visible, wrapped
from contactlab.rendering.amounts import format_percent
from contactlab.reporting.examination import (
    contact_lines,
    first_fix,
    fix_summary,
    label_line,
    labels_in_why,
    largest_rows,
    not_tried_line,
    phase_begins,
    row_error,
)
from contactlab.schema.drive import PolicyDrive
from contactlab.schema.error_budget import BudgetFix
from contactlab.schema.examination import Examination, Fix

_SHOWN = 0.1  # of the tolerance: rows above it are in the short table
_MOST_LINES = 6  # of a fix
_MOST_FIRST_LINES = 3  # of the first fix, in the head
_HEAD = "      "  # lines of the head after "why:  ", "fix:  " and "task: "
_REPLAYED = (
    "The error budget replays the actions of the policy; fixes are verified in its loop, where a "
    "finer step or another integrator has to reduce the tracking error."
)


def examination_lines(report: Examination, *, full: bool = False) -> list[str]:
    """Return the verdict, its causes and fix, the task, and the requested sections.

    In short, rows of the budget are those of the phase in which each is largest, above a tenth of
    the tolerance, and checks those that fail; in full, all rows of each phase, all fixes that were
    tried, all checks, and the contacts in units of the world.
    """
    alone = len(report.sections) == 1
    parts = [
        [*_head(report)],
        [
            *_labeled("task", report.task.line),
            *(wrapped(_REPLAYED) if isinstance(report.task.drive, PolicyDrive) else ()),
        ],
    ]
    if "budget" in report.sections:
        parts.append([*(_full_budget(report) if full else budget_table(report))])
    parts += [
        [*_labels(report)],
        [*_checks(report, every=full or alone)],
        [line for sentence in told_facts(report) for line in wrapped(sentence)],
        [line for contact in report.contacts for line in contact_lines(contact)]
        if full or alone
        else [],
        *([*_other_fix(number, fix, report)] for number, fix in enumerate(other_fixes(report), 2)),
        [line for note in report.notes for line in wrapped(note)] if full or alone else [],
        [line for end in _ends(report) for line in wrapped(end)],
    ]
    lines = [line for part in parts if part for line in ("", *part)]
    return [visible(line) for line in lines[1:]]


def _labeled(name: str, text: str) -> list[str]:
    """Wrap a text after its name, indented below it."""
    return textwrap.wrap(
        text,
        COLUMNS,
        initial_indent=f"{name + ':':{len(_HEAD)}}",
        subsequent_indent=_HEAD,
        break_long_words=False,
        break_on_hyphens=False,
    )


def _head(report: Examination) -> Iterator[str]:
    """Yield the verdict, its causes, and the first fix with the lines to write."""
    if not report.headline:
        return
    yield from wrapped(report.headline)
    for place, cause in enumerate(report.why):
        first, *rest = _labeled("why", cause)
        yield first if not place else f"{_HEAD}{first.removeprefix('why:  ')}"
        yield from rest
    if report.fix:
        yield from _labeled("fix", report.fix)
    if report.fixes:
        first = first_fix(report.fixes)
        yield from _code(first, _MOST_FIRST_LINES)
        if first.verification is not None:
            yield from textwrap.wrap(
                f"verified: {first.verification.sentence}",
                COLUMNS,
                initial_indent=_HEAD,
                subsequent_indent=_HEAD,
            )


def _code(fix: Fix, most: int) -> Iterator[str]:
    yield from (f"{_HEAD}{line}" for line in fix.lines[:most])
    if (more := len(fix.lines) - most) > 0:
        yield f"{_HEAD}and {more} more line{'s' * (more > 1)}, which --write writes"
    if fix.no_patch_reason:
        yield from textwrap.wrap(
            f"no lines: {fix.no_patch_reason}",
            COLUMNS,
            initial_indent=_HEAD,
            subsequent_indent=_HEAD,
        )


def told_facts(report: Examination) -> list[str]:
    """Return the sentences of the facts that are not among the causes."""
    return [fact.sentence for fact in report.facts if fact.sentence not in report.why]


def other_fixes(report: Examination) -> Sequence[Fix]:
    """Return all fixes except the first, which the head has."""
    if not report.fixes:
        return ()
    first = first_fix(report.fixes)
    return [fix for fix in report.fixes if fix is not first]


def _full_budget(report: Examination) -> Iterator[str]:
    yield from wrapped(f"{DEFINITION}. {NOTES}")
    begins = phase_begins(report.task)
    for phase in report.budget.phases if report.budget else ():
        yield from ("", *phase_lines(phase, begins.get(phase.name, 0.0), report.task.tolerance))
    yield from _tried(report)


def _labels(report: Examination) -> Iterator[str]:
    """Yield the labels that the causes lack; in the section alone, the numerics of each phase."""
    if report.task_verdict is None:
        return
    if report.sections == ("labels",):
        for phase in report.task_verdict.phases:
            runs = ", ".join(f"{name} in {count} runs" for name, count in phase.labels.items())
            numerics = "numerical error not measured"
            if phase.body:
                numerics = f"numerical error {share_text(phase.numerical_error)} in {phase.body}"
            yield from wrapped(f"{phase.name}: {numerics}; {runs or 'no failure label'}")
    told = labels_in_why(report)
    for label in report.labels:
        if label not in told:
            yield from wrapped(label_line(label, len(report.task.seeds)))


def _checks(report: Examination, *, every: bool) -> Iterator[str]:
    words = {"failed": "FAIL", "warned": "WARN", "passed": "pass", "skipped": "skip"}
    for finding in report.findings:
        if every or finding.outcome == "warned":
            yield from wrapped(f"{words.get(finding.outcome, 'note')} {finding.full_message}")
    for check in report.checks:
        if every:
            yield from (
                line for note in check.notes for line in wrapped(f"{check.name}: {note}", "  ")
            )


def budget_table(report: Examination) -> Iterator[str]:
    """Yield the numerical error and the rows that matter, each of its worst phase."""
    if report.budget is None:
        return
    found = largest_rows(report.budget, report.task)
    run = Placed(*found.pop(report.budget.phases[0].numerical_error.name))
    least = _SHOWN * report.budget.tolerance
    shown = {name: Placed(*at) for name, at in found.items() if row_error(at[0]) >= least}
    yield from wrapped(DEFINITION)
    yield from table_lines(run, list(shown.values()), report.budget.tolerance)
    if less := [name for name in found if name not in shown]:
        yield from wrapped(f"below {format_percent(least)}: {', '.join(less)}")
    rows = {row.name: None for phase in report.budget.phases for row in phase.rows}
    yield from unexercised_lines([name for name in rows if name not in found])


def _other_fix(number: int, fix: Fix, report: Examination) -> Iterator[str]:
    yield from wrapped(f"fix {number}: {fix_summary(fix, report)}")
    yield from _code(fix, _MOST_LINES)


def _ends(report: Examination) -> Iterator[str]:
    """Yield the skipped parts, and what to do next: the fixed model, the page, the evidence."""
    for fix in report.rejected_fixes:
        yield f"no fix: {fix.name}: {fix.reason}"
    if skipped := not_tried_line(report):
        yield skipped
    if report.written:
        yield f"fixed model: {report.written}"
    elif writable := [fix for fix in report.fixes if fix.lines]:
        own = [fix for fix in writable if not fix.changes_model]
        name = "" if own else f" --apply {first_fix(writable).apply}"
        yield f"--write FILE{name} writes the fixed model; fixes also hold on new seeds"
    if report.page:
        yield f"page: {report.page}"
    elif report.evidence:
        yield f"evidence: {report.evidence}"


def _tried(report: Examination) -> Iterator[str]:
    if report.budget and report.budget.fixes:
        yield ""
        yield f"{'fixes tried:':45} {'time':>6} {'error':>7}"
        yield from map(_tried_fix, report.budget.fixes)


def _tried_fix(fix: BudgetFix) -> str:
    ratio = f"x{fix.time_ratio.ratio:.2f}" if fix.time_ratio else ""
    end = "removes it" if fix.removes else f"still {fix.verdict}"
    error = "∞" if fix.error is None else format_percent(fix.error)
    return f"  {fix.name:43} {ratio:>6} {error:>7}  {end}"
