"""Concludes an examination: its verdict, a headline, the causes, and the first fix."""

import math
import re
from collections.abc import Iterator, Sequence

from contactlab.judge.conclusion import failed_names
from contactlab.modifications.catalogue import find_row, list_candidates, list_rows
from contactlab.rendering.amounts import LEAST_ERROR, format_error, format_percent
from contactlab.reporting.budget_document import phase_begins
from contactlab.reporting.examination import (
    ENERGY_CHECK,
    NUMERICAL_CHECK,
    check_of_reason,
    first_fix,
    fix_summary,
    judged_labels,
    judged_reasons,
    judges_task,
    label_line,
    labels_in_why,
)
from contactlab.schema.error_budget import BudgetPhase, BudgetReason
from contactlab.schema.examination import Cause, Examination, Fact
from contactlab.schema.finding import Finding
from contactlab.schema.task import QPOS0
from contactlab.schema.verdict import PASSING_VERDICTS, VerdictWord, join_verdict
from contactlab.studies.grip.grip_fact import is_held

_BY_HAND = "by hand: "
_OF_TASK = {NUMERICAL_CHECK, ENERGY_CHECK, "failure_labels"}  # which repeat budget and labels


def conclude(
    report: Examination, *, fixes_tried: int = 0, fixes_not_tried: Sequence[str] = ()
) -> Examination:
    """Return a report with its verdict, headline, causes, and the first fix."""
    reasons = judged_reasons(report)
    sure = [cause for cause in report.causes if cause.fails]  # whatever labels and numerics say
    failing = judged_labels(report) or _failed_checks(report) or sure
    verdict = join_verdict(reasons[0].verdict if reasons else "ok", failing=bool(failing))
    report = report.model_copy(update={"verdict": verdict})
    if verdict not in PASSING_VERDICTS and not report.causes:
        # A fault that another setting of collision removes alone.
        missed = {candidate.name: candidate.missed for candidate in list_candidates()}
        causes = tuple(
            Cause(stage="collision", sentence=sentence, repair=fix.name)
            for fix in report.fixes[:1]
            if (sentence := missed.get(fix.name))
        )
        report = report.model_copy(update={"causes": causes})
    headline = _write_headline(report, verdict)
    fix = _choose_fix(report, verdict, fixes_tried, len(fixes_not_tried))
    # The remedy at the end of a sentence is not repeated if it is the fix.
    remedy = f"; {fix.removeprefix(_BY_HAND)}" if fix.startswith(_BY_HAND) else ""
    sentences = [one.removesuffix(remedy) for one in _yield_causes(report, verdict) if one]
    # A sentence that the headline or a longer one has is not repeated.
    why = [
        one
        for place, one in enumerate(sentences)
        if not any(later.startswith(one) for later in sentences[place + 1 :])
    ]
    further_reasons = [one for one in why if not headline.endswith(f": {one}")]
    # Causes that the headline and the fix say are not repeated.
    why = further_reasons or ([] if report.causes and report.fixes else why)
    return report.model_copy(
        update={
            "headline": headline,
            "why": tuple(why),
            "fix": fix,
        }
    )


def _failed_checks(report: Examination) -> list[str]:
    # Except those that labels and the budget explain. A reason that passes explains no failure.
    reasons = [one for one in judged_reasons(report) if one.verdict not in PASSING_VERDICTS]
    explained = {check_of_reason(reason.row) for reason in reasons}
    if judged_labels(report):
        explained.add("failure_labels")
    return [name for name in failed_names(report.findings) if name not in _OF_TASK & explained]


def find_failed_checks(report: Examination) -> list[str]:
    """Return the names of the failed checks that judge the model, not its runs."""
    return [name for name in failed_names(report.findings) if name not in _OF_TASK]


def _write_headline(report: Examination, verdict: VerdictWord) -> str:
    reason = next(iter(judged_reasons(report)), None)
    tolerance = f"(tolerance {format_percent(report.task.tolerance)})"
    if report.causes:
        return f"{verdict}: {_shorten_cause(report.causes[0].sentence)}"
    if verdict == "fails":
        labels = list(dict.fromkeys(label.label for label in judged_labels(report)))
        causes = [*labels, *(f"check {name}" for name in _failed_checks(report))]
        most_named = 2
        shown_causes, more = causes[:most_named], len(causes) - most_named
        rest = f" and {more} more" if more > 0 else ""
        return f"fails: {' and '.join(shown_causes)}{rest}"
    if reason is None:
        return f"ok: {_why_ok(report, tolerance)}"
    if verdict == "depends":
        return f"depends on {find_row(reason.row).subject}: {reason.sentence}"
    return f"{verdict}: {reason.sentence}{'' if reason.row == 'warning' else f' {tolerance}'}"


def _shorten_cause(sentence: str) -> str:
    # To the end of a clause if one ends there: `why` has the whole sentence.
    most_words = 14  # 15 with the verdict
    clause = re.split("[:;]", sentence)[0]
    words = clause.split()
    if len(words) <= most_words:
        return clause
    shortened = " ".join(words[:most_words])
    return shortened.rpartition(",")[0] or f"{shortened} ..."


def _why_ok(report: Examination, tolerance: str) -> str:
    if waived := _waived_findings(report):
        return f"{' and '.join(finding.name for finding in waived)} waived"
    if not judges_task(report):
        return f"no check failed ({', '.join(check.name for check in report.checks)})"
    if report.budget is None:
        return "no failure label, and nothing moves in MuJoCo"
    phase = max(report.budget.phases, key=_error_of)
    worst = phase.numerical_error.body
    error = _error_of(phase)
    where = f" in {worst}" if error >= LEAST_ERROR else ""
    return f"numerical error {format_error(error)}{where} {tolerance}"


def _waived_findings(report: Examination) -> list[Finding]:
    return [finding for finding in report.findings if finding.waived]


def _error_of(phase: BudgetPhase) -> float:
    row = phase.numerical_error
    return math.inf if row.infinite else row.error or 0.0


def _yield_causes(report: Examination, verdict: VerdictWord) -> Iterator[str]:
    # The main cause comes first, after conditions of the judgment.
    yield from (fact.sentence for fact in report.facts if fact.kind == "limp")
    if verdict in PASSING_VERDICTS:
        # Sound numerics say nothing of a pose that the model does not hold.
        yield from (fact.sentence for fact in report.facts if fact.kind == "fall")
        if _touches_nothing(report):
            yield "no contact was made in the task, so nothing about contact is judged"
    fix = fix_summary(first_fix(report.fixes), report) if report.fixes else ""
    for cause in report.causes:
        yield cause.sentence
        if cause.remainder and cause.remainder not in fix:
            yield f"with {cause.repair}: {cause.remainder}"
    if report.causes and report.causes[-1].remainder:
        return  # the rest follows from the causes
    if verdict != "ok":
        has_start_cause = any(cause.stage == "start" for cause in report.causes)
        facts = [*([] if has_start_cause else _list_causing_overlaps(report, verdict))]
        facts += [fact for fact in report.facts if fact.kind == "advisory" and fact.value]
        yield from (fact.sentence for fact in facts)
    failed = {*_failed_checks(report)}
    # A check of the kind of a fact that a cause states has the same numbers.
    stated = {
        fact.kind
        for fact in report.facts
        if any(fact.sentence in cause.sentence for cause in report.causes)
    }
    failures = [
        *(label_line(label, len(report.task.seeds)) for label in labels_in_why(report)),
        *(
            finding.full_message
            for finding in report.findings
            if finding.name in failed and finding.kind not in stated
        ),
    ]
    numerics = [*_list_numerics(report, verdict)]
    yield from (*failures, *numerics) if verdict == "fails" else (*numerics, *failures)
    passes = verdict in PASSING_VERDICTS
    grips = (fact for fact in report.facts if fact.kind == "grip")
    yield from (fact.sentence for fact in grips if passes or not is_held(fact))


def _list_causing_overlaps(report: Examination, verdict: VerdictWord) -> Iterator[Fact]:
    # A modeling choice is judged where its forces are, so no other contact decides on it.
    place = reasons[0].place if (reasons := judged_reasons(report)) else ""
    for fact in report.facts:
        if fact.kind == "overlap" and fact.value and (verdict != "depends" or fact.place == place):
            yield fact


def _touches_nothing(report: Examination) -> bool:
    if report.budget is None or not judges_task(report):
        return False
    rows = [row for phase in report.budget.phases for row in phase.rows]
    contacts = [row.exercised for row in rows if row.name == "contact softness"]
    is_measured = "contact softness" not in report.not_tried
    return bool(contacts) and is_measured and not any(contacts)


def _list_numerics(report: Examination, verdict: VerdictWord) -> Iterator[str]:
    """Yield where the numerical error, or the effect of a modeling choice, is largest."""
    if report.budget is None or not judges_task(report):
        return
    reasons = judged_reasons(report)
    if not reasons:
        if waived := _waived_findings(report):
            yield from (finding.full_message for finding in waived)
            return
        phase = max(report.budget.phases, key=_error_of)
        yield from _list_disagreements(report)
        if verdict == "ok":
            place = phase.numerical_error.place
            begin = phase_begins(report.task).get(phase.name, 0.0)
            time = begin + (phase.numerical_error.time or 0.0)
            where = f"; the numerical error is largest at {place}, {time:.2f} s"
            is_measurable = place and _error_of(phase) >= LEAST_ERROR
            yield f"no failure label{where if is_measurable else ''}"
        elif NUMERICAL_CHECK not in _failed_checks(report):
            yield _choices_line(report, ())
        return
    yield from _list_disagreements(report)
    first, *others = reasons
    phase = next(each for each in report.budget.phases if each.name == first.phase)
    if verdict != "fails":
        yield _place_line(report, first, phase)
    if first.verdict == "depends":
        yield _choices_line(report, others if verdict == "depends" else (first, *others))


def _list_disagreements(report: Examination) -> Iterator[str]:
    """Yield how near to the tolerance the numerical error is, if seeds disagree about it."""
    assert report.budget is not None
    for phase in report.budget.phases:
        interval, above = phase.numerical_error.seeds, phase.seeds_above
        if interval and 0 < above < phase.seeds:
            low, high = map(format_percent, interval)
            limit = format_percent(report.budget.tolerance)
            yield (
                f"near the tolerance: numerical errors of {low} to {high} over {phase.seeds} seeds "
                f"in phase {phase.name}, {above} of them above {limit}"
            )


def _place_line(report: Examination, reason: BudgetReason, phase: BudgetPhase) -> str:
    """Say where and when a reason is largest, and its cause if that is known."""
    at = f" at {reason.place}" if reason.place else ""
    if reason.time is None:
        at += f" in the phase {reason.phase}"
    else:
        begin = phase_begins(report.task).get(reason.phase, 0.0)
        at += f"{', ' if at else ' at '}{begin + reason.time:.2f} s"
    match reason.row:
        case "warning":
            return f"its forces first differ from those of the reference{at}"
        case "energy":
            verb = "gains" if reason.error > 0 else "loses"
            return f"the run {verb} energy that the exact motion does not, most{at}"
        case "reference":
            error = format_percent(_error_of(phase))
            return (
                f"the measured error is {error}, but its references at 1/4 and 1/8 of the time "
                f"step still differ, most{at}"
            )
        case _ if reason.verdict == "depends":
            # A place of another kind than the choice is replaced by its body.
            kinds = {"limit softness": "joint", "equality softness": "equality"}
            if reason.place and not reason.place.startswith(kinds.get(reason.row, "")):
                at = at.replace(f" at {reason.place}", f" in {reason.body}", 1)
            return (
                f"the numerics are fine (numerical error {format_error(_largest_error(report))}), "
                f"but this modeling choice decides the motion, most{at}"
            )
        case _:
            return f"{_main_cause(phase)}{at}"


def _main_cause(phase: BudgetPhase) -> str:
    """Return the numerical setting that causes most of a numerical error."""
    whole = _error_of(phase)
    causes = {row.name: row.cause for row in list_rows() if row.cause}
    rows = {row.name: row for row in phase.rows if row.name in causes}
    errors = {name: math.inf if row.infinite else row.error or 0.0 for name, row in rows.items()}
    main = max(errors, key=lambda name: errors[name], default="")
    main_share = 0.5  # of the numerical error; a setting with more is its main cause
    if main and math.isfinite(whole) and errors[main] >= main_share * whole:
        return causes[main]
    return "the numerical error is largest"


def _choices_line(report: Examination, reasons: Sequence[BudgetReason]) -> str:
    """Say on which modeling choices the motion depends too, and how accurate the numerics are."""
    assert report.budget is not None
    first = judged_reasons(report)[0].row if report.verdict == "depends" else ""
    choices: dict[str, str] = {}
    for reason in reasons:
        if reason.verdict == "depends" and reason.row != first:
            choices.setdefault(
                reason.row, f"{find_row(reason.row).subject} ({_format_error(reason.error)})"
            )
    also = f"also depends on {' and '.join(choices.values())}" if choices else ""
    if report.verdict == "depends":
        return also
    # Labels have the error of their own run, which a second number seems to contradict.
    if any("numerical error" in label.reason for label in labels_in_why(report)):
        return also
    error = format_error(_largest_error(report))
    fine = f"numerical error {error}, at most {format_percent(report.budget.tolerance)} is allowed"
    return "; ".join(filter(None, (also, fine)))


def _largest_error(report: Examination) -> float:
    assert report.budget is not None
    return max(map(_error_of, report.budget.phases))


def _format_error(error: float | None) -> str:
    return format_percent(math.inf if error is None else abs(error))


def _choose_fix(report: Examination, verdict: VerdictWord, tried_count: int, not_tried: int) -> str:
    if report.fixes:
        first = first_fix(report.fixes)
        summary = fix_summary(first, report)
        return (
            f"none if that choice is intended; otherwise {summary}"
            if verdict == "depends" and not first.moves_start
            else summary
        )
    if verdict == "ok":
        return "not needed"
    for cause in report.causes:
        # The sentence of such a fault ends with its remedy.
        _, has_remedy, remedy = cause.sentence.rpartition("; ")
        by_hand = cause.stage == "file" or "contactlab grip" in remedy
        if has_remedy and by_hand and not cause.repair:
            return remedy if "contactlab grip" in remedy else f"{_BY_HAND}{remedy}"
    start = report.task.start if report.task.start == QPOS0 else f"keyframe {report.task.start}"
    overlaps = any(_list_causing_overlaps(report, verdict))
    first = [f"move the bodies apart in {start}"] if overlaps else []
    first += [
        f"avoid {fact.place}" for fact in report.facts if fact.kind == "advisory" and fact.value
    ]
    # What is left after these is another model's verdict.
    if first:
        return f"{' and '.join(first)}, and examine the model again"
    return _no_fix(report, tried_count, not_tried)


def _no_fix(report: Examination, tried_count: int, not_tried: int) -> str:
    if "fixes" not in report.sections:
        return f"not searched; contactlab {report.model} searches for one"
    if report.rejected_fixes:
        first = report.rejected_fixes[0]
        more = len(report.rejected_fixes) - 1
        others = f"; {more} more were rejected" if more else ""
        return f"none: {first.name} was rejected: {first.reason}{others}"
    if not tried_count:
        return "no time to try one; --max-cpu 5min allows more" if not_tried else "none is known"
    none = (
        f"none of {tried_count} tried removes it"
        if tried_count > 1
        else "the one tried does not remove it"
    )
    more = f"; {not_tried} were not tried in time" if not_tried else ""
    return f"{none}{more}"
