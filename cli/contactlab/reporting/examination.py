"""Words for parts of an examination, as its text and its page tell them."""

import math
from collections.abc import Iterable

from contactlab.printable import percent
from contactlab.schema.error_budget import BudgetReport, BudgetRow
from contactlab.schema.examination import Examination, ModelChange, RestingContact
from contactlab.schema.task import Task


def largest_rows(budget: BudgetReport, task: Task) -> dict[str, tuple[BudgetRow, float]]:
    """Return the rows that are exercised, each of the phase in which it is largest.

    With it comes when that phase begins [s].
    """
    begins = phase_begins(task)
    found: dict[str, tuple[BudgetRow, float]] = {}
    for phase in budget.phases:
        for row in (phase.run, *phase.rows):
            kept = found.get(row.name)
            if row.exercised and (kept is None or row_size(row) > row_size(kept[0])):
                found[row.name] = row, begins.get(phase.name, 0.0)
    return found


def row_size(row: BudgetRow) -> float:
    """Return the share of a row; infinite where the engine gave up, 0 if unknown."""
    return math.inf if row.infinite else row.share or 0.0


def phase_begins(task: Task) -> dict[str, float]:
    """Return when the phases of a task begin [s], by name."""
    return {phase.name: phase.begin for phase in task.phases}


def change_line(number: int, change: ModelChange) -> str:
    """Return a change in one line: its kind, what it leaves, and its price."""
    kind = "the same model, computed otherwise"
    if change.physics:
        kind = f"another model (--accept {change.accept})"
    cost = f", at {change.price.ratio:.2f} times the time" if change.price else ""
    left = f", leaves {percent(change.share)}" if change.share is not None else ""
    if change.removes == "labels":
        left = ", leaves no label"
    elif change.removes == "overlap":
        left = ", without what is absurd at the start; its verdict is no worse"
    return f"{number}. {change.name}: {kind}{left}{cost}"


def untried_line(report: Examination) -> str:
    """Return what there was no time for, in a sentence; empty if there was for all."""
    if not report.untried:
        return ""
    return f"not tried, to end in time: {', '.join(report.untried)}; --max-cpu 5min allows for more"


def grouped_contacts(contacts: Iterable[RestingContact]) -> list[list[str]]:
    """Say the settings of contacts in units of the world; those that are alike are said once."""
    names: dict[tuple[str, ...], list[str]] = {}
    for contact in contacts:
        head, *rest = contact_lines(contact)
        solref = head.removeprefix(f"{contact.name}:").strip()
        names.setdefault((solref, *rest), []).append(contact.name)
    return [[f"{', '.join(of) + ':':<14} {solref}", *rest] for (solref, *rest), of in names.items()]


def contact_lines(contact: RestingContact) -> list[str]:
    """Say a contact's settings in units of the world."""
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
    said = {
        f"{contact.name}:": f'solref="{" ".join(f"{number:.6g}" for number in contact.solref)}"',
        **rest,
        "in an impact": f"{contact.stiffness:.4g} N/m, {contact.damping:.4g} N s/m, ratio "
        f"{contact.damping_ratio:.4g}",
        "restitution": f"{contact.restitution:.3g}, without gravity",
        "timestep": f"at most {most:.4g} ms; it is {now:.4g} ms",
    }
    return [f"{name:<14} {text}" for name, text in said.items()]
