"""The findings of a study of successes, for CI."""

from contactlab.rendering.amounts import format_interval, format_percent
from contactlab.schema.finding import Finding, Outcome, Verdict
from contactlab.schema.success import SuccessReport
from contactlab.studies.success.success_document import headline_of
from contactlab.writers.report import Report


def report_of(report: SuccessReport) -> Report:
    """Return the report for the writers: a finding for each requirement and each variant."""
    findings = list[Finding]()
    for each in report.requirements:
        share = report.written if each.quantity == "success" else report.physical
        passed = each.outcome == "met"
        text = f"{format_percent(share.share)} ({format_interval(share.low, share.high)})"
        if each.outcome == "undecided":
            text += "; undecided"
            text += f": about {each.needed:,} episodes would decide it" if each.needed else ""
        findings.append(
            Finding(
                name=each.text,
                kind="requirement",
                level="gate",
                outcome="passed" if passed else "failed",
                verdict="met" if passed else "unmet",
                judged=share.episodes,
                failing=0 if passed else share.episodes - share.good,
                message=text,
                value=share.share,
                limit=each.least,
                unit="1",
            )
        )
    for each in report.variants:
        share = each.success
        changed = each.kind == "numerics" and each.lost > 0
        outcome: Outcome = "noted" if changed else "passed"
        verdict: Verdict = "worse" if changed else "same"
        text = each.problem
        if share is not None:
            ends = format_interval(share.low, share.high)
            text = f"{format_percent(share.share)} ({ends}), {each.lost} lost, {each.gained} gained"
        findings.append(
            Finding(
                name=each.name,
                kind="variant",
                level="note",
                outcome="skipped" if share is None else outcome,
                verdict="not comparable" if share is None else verdict,
                judged=share.episodes if share else 0,
                failing=each.lost,
                message=text,
            )
        )
    return Report(
        title=f"contactlab success {report.source}",
        place=("success",),
        headline=headline_of(report),
        passed=not report.problem,
        record=report,
        findings=tuple(findings),
        notes=(*report.not_checked, *report.notes),
    )
