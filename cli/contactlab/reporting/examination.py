"""Words for parts of an examination, for its text and its page."""

from collections.abc import Iterable, Sequence
from math import isinf

from contactlab.judge.conclusion import failed_names
from contactlab.rendering.amounts import format_error, format_percent
from contactlab.schema.error_budget import BudgetReason
from contactlab.schema.examination import Examination, Fix, RestingContact, RunLabel

NUMERICAL_CHECK, ENERGY_CHECK = "numerical_error", "energy_drift"
"""Findings of the check of a task that the reasons of its budget fail."""


def judged_labels(report: Examination) -> Sequence[RunLabel]:
    """Return the failure labels, unless the check of labels was waived or not selected."""
    failed = failed_names(report.findings)
    return report.labels if not report.findings or "failure_labels" in failed else ()


def judged_reasons(report: Examination) -> Sequence[BudgetReason]:
    """Return the reasons of the budget, except those of waived and unselected checks."""
    if report.budget is None or not report.findings:
        return report.budget.reasons if report.budget else ()
    failed, selected = failed_names(report.findings), judges_task(report)
    return [
        reason
        for reason in report.budget.reasons
        if (selected if reason.verdict == "depends" else check_of_reason(reason.row) in failed)
    ]


def judges_task(report: Examination) -> bool:
    """Return whether numerics and labels are judged: no checks are selected, or this one is too."""
    return not report.findings or any(finding.kind == "task" for finding in report.findings)


def check_of_reason(row: str) -> str:
    """Return the name of the finding that a reason of the budget fails."""
    return ENERGY_CHECK if row == "energy" else NUMERICAL_CHECK


def labels_in_why(report: Examination) -> Sequence[RunLabel]:
    """Return the failure labels that the causes of a verdict name."""
    most_labels = 2
    return judged_labels(report)[:most_labels]


def label_line(label: RunLabel, seeds: int) -> str:
    """Return a label in a line: its bodies, phase and reason, and the number of its runs."""
    of_runs = f" ({label.runs} of {seeds} runs)" if label.runs < seeds else ""
    return f"{label.label}{label.where} in phase {label.phase}: {label.reason}{of_runs}"


def first_fix(fixes: Sequence[Fix]) -> Fix:
    """Return the fix to make first: one of the start or of overlaps, since that is the cause.

    Other shapes come after a fix that keeps the model and removes the verdict, too.
    """
    keeps_model = not fixes[0].changes_model
    structural = [
        fix for fix in fixes if fix.is_structural and not (keeps_model and fix.replaced_meshes)
    ]
    return (structural or fixes)[0]


_CHANGED_NUMBERS = {"energy": "energy drift", "reference": "upper bound of the error"}
"""Names of the numbers that the reasons of a budget have, except for rows."""


def fix_summary(fix: Fix, report: Examination) -> str:
    """Return a fix in one line: its name, its effect, its time, and whether the model changes.

    The effect is on the number of the first reason of the report's budget.
    """
    reason = report.budget.reasons[0] if report.budget and report.budget.reasons else None
    effect = "" if fix.error is None else f"error falls to {format_error(fix.error)}"
    if fix.error is not None and reason is not None:
        number = _CHANGED_NUMBERS.get(reason.row, "numerical error")
        if reason.verdict == "depends":
            number = f"effect of {reason.row}"
        before = "infinite" if isinf(reason.error) else format_percent(abs(reason.error))
        effect = f"{number} falls from {before} to {format_error(fix.error)}"
    if fix.removes == "labels":
        effect = "no failure label is left"
    elif verdicts := [
        one.remainder or f"'{one.verdict}'"
        for one in report.causes
        if one.repair == fix.name and one.verdict
    ]:
        effect = f"the verdict is then {verdicts[0]}"
    elif fix.removes == "overlap":
        effect = "no bodies overlap at the start, and the verdict is not worse"
    changes = "changes the model" if fix.changes_model else ""
    parts = ", ".join(filter(None, (effect, time_text(fix), changes)))
    return f"{fix.name}: {parts}" if parts else fix.name


def time_text(fix: Fix) -> str:
    """Return the time of a run with a fix over that of one without, in words; "" if unknown."""
    if fix.time_ratio is None:
        return ""
    ratio = fix.time_ratio.ratio
    return f"same speed (x{ratio:.2f} time)" if fix.time_ratio.is_equal() else f"x{ratio:.2f} time"


def not_tried_line(report: Examination) -> str:
    """Return the rows and fixes that were skipped, in a sentence; empty if there are none."""
    if not report.not_tried:
        return ""
    most_names = 3
    shown_names, more = report.not_tried[:most_names], len(report.not_tried) - most_names
    rest = f" and {more} more" if more > 0 else ""
    return (
        f"not tried within the CPU limit: {', '.join(shown_names)}{rest}; --max-cpu 5min allows "
        "more"
    )


def grouped_contacts(
    contacts: Iterable[RestingContact],
) -> dict[str, tuple[tuple[str, str], ...]]:
    """Return the settings of contacts by name, in units of the world; those alike stand once."""
    names: dict[tuple[tuple[str, str], ...], list[str]] = {}
    for contact in contacts:
        names.setdefault(contact_facts(contact), []).append(contact.name)
    return {", ".join(alike): facts for facts, alike in names.items()}


def contact_facts(contact: RestingContact) -> tuple[tuple[str, str], ...]:
    """Return the settings of a contact in units of the world, each after its name."""
    rest = {"depth_at_rest": f"it does not rest at the end of its {contact.phase} phase"}
    if contact.expected_depth is not None:
        depth = contact.expected_depth
        count = contact.contacts  # a mean over time
        each = "one contact" if count == 1 else f"each of {count:.3g} contacts"
        bears = f"{contact.load:.4g} N on {each}"
        rest = {
            "stiffness": f"{contact.load / depth:.4g} N/m at rest, load over depth",
            "depth_at_rest": f"{depth * 1e3:.4g} mm under {bears}; measured "
            f"{contact.depth * 1e3:.4g} mm",
        }
    most, now = contact.longest_step * 1e3, contact.timestep * 1e3
    facts = {
        "solref": " ".join(f"{number:.6g}" for number in contact.solref),
        **rest,
        "in an impact": f"{contact.stiffness:.4g} N/m, {contact.damping:.4g} N s/m, ratio "
        f"{contact.damping_ratio:.4g}",
        "restitution": f"{contact.restitution:.3g}, without gravity",
        "timestep": f"at most {most:.4g} ms; it is {now:.4g} ms",
    }
    return tuple(facts.items())
