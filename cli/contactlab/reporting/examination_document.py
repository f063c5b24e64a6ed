"""Describes an examination: its verdict, causes and fix, the task, and the requested sections."""

from collections.abc import Iterator, Sequence

from contactlab.rendering.amounts import format_amount, format_digits
from contactlab.rendering.document import (
    Block,
    Code,
    Column,
    Document,
    Facts,
    Headline,
    Items,
    Row,
    Section,
    Sentence,
    Table,
    document_of,
    table_of,
)
from contactlab.reporting.budget_document import (
    DEFINITION,
    NOTES,
    phase_begins,
    phase_section,
    share_text,
    worst_rows_section,
)
from contactlab.reporting.examination import (
    first_fix,
    fix_summary,
    grouped_contacts,
    label_line,
    labels_in_why,
    not_tried_line,
)
from contactlab.reporting.loop_words import loop_blocks
from contactlab.reporting.servo_words import servo_tables
from contactlab.reporting.verified_measures import measure_rows
from contactlab.schema.check_report import CheckResult, Measure
from contactlab.schema.drive import PolicyDrive
from contactlab.schema.error_budget import BudgetReport
from contactlab.schema.examination import Examination, Examinations, Fix
from contactlab.schema.finding import Finding, PlacedFinding
from contactlab.schema.verification import VerifiedChange
from contactlab.writers.report import Report
from contactlab.writers.signs import outcome_mark


def describe_examination(
    report: Examination, *, details: bool = False, phases: bool = False, model: str = ""
) -> Document:
    """Describe an examination.

    Args:
        report: the examination.
        details: whether all checks with their measures, the contacts in units of the world and the
            notes are described too, or only checks that warn.
        phases: whether the budget has all rows of each phase, and all fixes that were tried, or
            each row of the phase where it is largest, if above a tenth of the tolerance.
        model: named before the headline, where several models are in one place.
    """
    details_or_alone = details or len(report.sections) == 1
    task: list[Block] = [Facts((("task", report.task.line),), colon=True)]
    if isinstance(report.task.drive, PolicyDrive):
        task.append(
            Sentence(
                "The error budget replays the actions of the policy; fixes are verified in its "
                "loop, where a finer step or another integrator has to reduce the tracking error."
            )
        )
    sections = [*_head_sections(report, model), Section(tuple(task), "task")]
    if report.requested and not report.missed:
        sections.append(Section((Sentence("verified by a run with these settings"),), "requested"))
    if report.budget is not None and "budget" in report.sections:
        if phases:
            sections += _full_budget(report, report.budget)
        else:
            sections.append(worst_rows_section(report.budget, report.task))
    sections.append(Section(tuple(_label_blocks(report)), "labels"))
    sections.append(Section(tuple(_finding_blocks(report, every=details_or_alone)), "checks"))
    if details:
        sections += map(_check_section, report.checks)
    # A reason ends with its place in parentheses; a finding of a file begins with it.
    reasons = [reason.rpartition(" (")[0] or reason for reason in report.why]
    new_facts = [
        Sentence(fact.sentence)
        for fact in report.facts
        if not any(fact.sentence in reason for reason in report.why)
        and not any(one in fact.sentence for one in reasons)
    ]
    sections.append(Section(tuple(new_facts), "facts"))
    if details_or_alone:
        sections += [
            Section((Facts(facts),), "contacts", title=names)
            for names, facts in grouped_contacts(report.contacts).items()
        ]
    if details_or_alone and report.servos:
        first = report.servos[0]
        step = f"step {format_amount(first.timestep, 'ms')}, {first.integrator}"
        sections.append(Section((*servo_tables(report.servos),), "servos", f"servos: {step}"))
    if details_or_alone and report.loop is not None:
        sections.append(Section((*loop_blocks(report.loop),), "loop", "loop of the policy"))
    others = (fix for fix in report.fixes if fix is not first_fix(report.fixes))
    sections += [
        Section(
            (
                Sentence(f"fix {number}: {fix_summary(fix, report)}"),
                *_list_fix_lines(fix, most=6),
            ),
            "fixes",
        )
        for number, fix in enumerate(others, 2)
    ]
    # Its result is with its fix.
    verified = next((fix for fix in report.fixes if fix.verification is not None), None)
    if details and verified and verified.verification and verified.verification.measures:
        title = f"Measures before and after: {verified.name}"
        table = _verified_table(verified.verification)
        sections.append(Section((table,), "verified", title, folded=True))
    notes = report.notes if details_or_alone else ()
    sections.append(Section(tuple(map(Sentence, notes)), "notes"))
    sections.append(Section(tuple(map(Sentence, _list_next_steps(report))), "ends"))
    return document_of(*sections)


def describe_examinations(
    report: Examinations, *, details: bool = False, phases: bool = False, model: str = ""
) -> Document:
    """Describe examinations: the models that do not pass, then each model as one alone."""
    del model
    head = Section((Headline(report.headline),), "headline")
    documents = [
        describe_examination(one, details=details, phases=phases, model=one.model)
        for one in report.examinations
    ]
    return document_of(head, *(section for one in documents for section in one.sections))


def findings_of_examinations(report: Examinations) -> Report:
    """Return the findings of several models, each under its model's name."""
    each = [findings_of_examination(one) for one in report.examinations]
    return Report(
        title="contactlab examine",
        place=("examine",),
        headline=report.headline,
        passed=not report.failing_models,
        record=report,
        facts=tuple((one.model, one.headline) for one in report.examinations),
        findings=tuple(
            finding.model_copy(update={"group": one.model})
            for one, model_report in zip(report.examinations, each, strict=True)
            for finding in model_report.findings
        ),
    )


def findings_of_examination(report: Examination) -> Report:
    """Return the findings of an examination, for JUnit and annotations of a job."""
    facts = [("why", cause) for cause in report.why]
    facts += [("fix", report.fix)] if report.fix else []
    facts.append(("task", report.task.line))
    if report.task_verdict is not None:
        facts.append(("verdict", report.task_verdict.line))
    return Report(
        title=f"contactlab examine {report.model}",
        place=(report.model,),
        headline=f"{report.model}: {report.headline}",
        passed=report.passed,
        record=report,
        facts=(*facts, ("engine", f"mujoco {report.mujoco}")),
        findings=(*_verdict_finding(report), *report.findings),
    )


def _verdict_finding(report: Examination) -> Iterator[Finding]:
    """Yield the verdict as a finding, unless a failed check says it; at the line of a fix."""
    if report.verdict is None or any(one.outcome == "failed" for one in report.findings):
        return
    lines = first_fix(report.fixes).lines if report.fixes else ()
    file, _, rest = lines[0].partition(":") if lines else (report.model, "", "1")
    yield PlacedFinding(
        name="verdict",
        kind="task",
        level="gate",
        outcome="passed" if report.passed else "failed",
        verdict="met" if report.passed else "unmet",
        judged=1,
        failing=int(not report.passed),
        message=report.headline,
        file=file,
        line=int(rest.partition(":")[0]),
        fix=tuple(lines),
    )


def _head_sections(report: Examination, model: str) -> Iterator[Section]:
    """Yield the verdict, its causes, and the first fix with the lines to write."""
    if not report.headline:
        return
    headline = f"{model}: {report.headline}" if model else report.headline
    yield Section((Headline(headline),), "headline")
    entries = [("" if place else "why", cause) for place, cause in enumerate(report.why)]
    entries += [("fix", report.fix)] if report.fix else []
    blocks: list[Block] = [Facts((*entries,), colon=True)]
    if report.fixes:
        first = first_fix(report.fixes)
        blocks += _list_fix_lines(first, most=3)
        if first.lines and report.model.endswith(".urdf"):
            blocks.append(Sentence("A URDF has no place for it: --write FILE writes a new MJCF."))
        if first.verification is not None:
            blocks.append(Sentence(first.verification.line))
    # The line of the fix names it if no fix remains.
    if report.fixes and report.rejected_fixes:
        rejected, more = report.rejected_fixes[0], len(report.rejected_fixes) - 1
        others = f" ({more} more were rejected)" if more else ""
        blocks.append(Sentence(f"no fix: {rejected.name}: {rejected.reason}{others}"))
    yield Section(tuple(blocks), "causes", follows=True)


def _list_fix_lines(fix: Fix, most: int) -> Iterator[Block]:
    if fix.lines:
        more = len(fix.lines) - most
        rest = f"and {more} more line{'s' * (more > 1)}, which --write writes" if more > 0 else ""
        yield Code(fix.lines[:most], more=rest, indent=5)
    if fix.controller:
        yield Sentence(fix.controller)
    if fix.no_patch_reason:
        yield Sentence(f"no lines: {fix.no_patch_reason}")


def _verified_table(verified: VerifiedChange) -> Table:
    """Return the measures of a fix next to those of the model as written."""
    heads = (
        "measure",
        "run",
        Column("original", "right"),
        Column("changed", "right"),
        Column("tolerance", "right"),
        "where",
    )
    rows = [
        (row.name, row.run, row.before, row.after, f"{row.tolerance} {row.unit}", row.place)
        for row in measure_rows(verified.measures)
    ]
    return table_of(heads, rows)


def _full_budget(report: Examination, budget: BudgetReport) -> Iterator[Section]:
    begins = phase_begins(report.task)
    yield Section((Sentence(f"{DEFINITION}. {NOTES}"),), "budget")
    for phase in budget.phases:
        yield phase_section(phase, begins.get(phase.name, 0.0), report.task.tolerance)
    if budget.fixes:
        rows = [
            (
                fix.name,
                format_amount(fix.time_ratio.ratio, "x") if fix.time_ratio else "",
                share_text(fix.error),
                "removes it" if fix.removes else f"still {fix.verdict}",
            )
            for fix in budget.fixes
        ]
        header = ("fixes tried", Column("time", "right"), Column("error", "right"), "")
        yield Section((table_of(header, rows),), "tried")


def _label_blocks(report: Examination) -> Iterator[Block]:
    """Yield the labels that the causes lack; in the section alone, the numerics of each phase."""
    if report.task_verdict is None:
        return
    if report.sections == ("labels",):
        for phase in report.task_verdict.phases:
            runs = ", ".join(f"{name} in {count} runs" for name, count in phase.labels.items())
            numerics = "numerical error not measured"
            if phase.body:
                numerics = f"numerical error {share_text(phase.numerical_error)} in {phase.body}"
            yield Sentence(f"{phase.name}: {numerics}; {runs or 'no failure label'}")
    explained = labels_in_why(report)
    for label in report.labels:
        if label not in explained:
            yield Sentence(label_line(label, len(report.task.seeds)))


def _finding_blocks(report: Examination, *, every: bool) -> Iterator[Block]:
    shown_findings = [one for one in report.findings if every or one.outcome == "warned"]
    if shown_findings:
        rows = tuple(Row((outcome_mark(one.outcome), one.full_message)) for one in shown_findings)
        yield Table((Column(""), Column("")), rows)
    notes = [f"{check.name}: {note}" for check in report.checks for note in check.notes]
    if every and notes:
        yield Items(tuple(notes))


def _check_section(check: CheckResult) -> Section:
    """Return a check with its question, its reason, its measures and the place of its evidence."""
    lines = [f"question: {check.question}", check.reason]
    lines += [f"evidence: {', '.join(check.stores)}"] if check.stores else []
    blocks: list[Block] = [Items(tuple(filter(None, lines)))]
    if check.measures:
        header = ("number", "of", "value", "limit", "")
        blocks.append(table_of(header, [_measure_row(one) for one in check.measures]))
    return Section(tuple(blocks), "measures", f"{check.name}: {check.verdict}", folded=True)


def _measure_row(measure: Measure) -> Sequence[str]:
    verdict = {None: "", True: "holds", False: "exceeded"}[measure.holds]
    limit = "" if measure.limit is None else _number_with_unit(measure.limit, measure.unit)
    value = "none" if measure.value is None else _number_with_unit(measure.value, measure.unit)
    return measure.name.replace("_", " "), measure.of or "", value, limit, verdict


def _number_with_unit(value: float, unit: str) -> str:
    return format_digits(value, 4) + ("" if unit == "1" else f" {unit}")


def _list_next_steps(report: Examination) -> Iterator[str]:
    """Yield the skipped parts, and what to do next: the fixed model, the page, the evidence."""
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
