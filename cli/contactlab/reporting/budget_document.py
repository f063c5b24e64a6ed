"""Describes an error budget: a table of each phase, or of the worst phase of each row."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from contactlab.rendering.amounts import (
    LEAST_ERROR,
    format_above,
    format_amount,
    format_percent,
    format_table_error,
)
from contactlab.rendering.document import (
    Bar,
    Block,
    Column,
    Document,
    Headline,
    Items,
    Row,
    Section,
    Sentence,
    Table,
    document_of,
)
from contactlab.schema.error_budget import BudgetPhase, BudgetReason, BudgetReport, BudgetRow
from contactlab.schema.task import Task

_GROUPS = {
    "numerics": "numerical settings, if changed",
    "model": "modeling choices, if changed",
    "effect": "effects, if left out",
    "unknown": "uncertain parameters, if varied",
}
_HEADS = (
    Column(""),
    Column("error", "right"),
    Column("over seeds", "right"),
    Column(""),
    Column("time", "right"),
    Column("worst body, when", breakable=True),
)
DEFINITION = "error budget: residual force as a share of the real forces, in the worst body"
NOTES = (
    "Bars are logarithmic, from 0.1 to 1000 %. The time is that of a run with the change over one "
    "without."
)


class PlacedRow(NamedTuple):
    """A row of a budget, and when its phase begins [s]; times count from the start of the run."""

    row: BudgetRow
    begin: float = 0.0


def describe_budget(report: BudgetReport) -> Document:
    """Describe a budget alone: its verdict with the reasons, and the table of each phase."""
    verdict = f"{report.verdict} (tolerance {format_percent(report.tolerance)})"
    reasons = tuple(f"{reason.sentence}{_place_of(reason)}" for reason in report.reasons)
    head = [Headline(verdict), *([Items(reasons)] if reasons else [])]
    return document_of(
        head, *(phase_section(phase, 0.0, report.tolerance) for phase in report.phases)
    )


def _place_of(reason: BudgetReason) -> str:
    place = "" if reason.place in reason.sentence else reason.place
    time = "" if reason.time is None else f"at {format_amount(reason.time, 's')}"
    return "".join(f", {part}" for part in (place, time) if part)


def phase_section(phase: BudgetPhase, begin: float, tolerance: float) -> Section:
    """Return the budget of a phase that begins at a time [s], with numbers that are not judged."""
    span = f"{begin:.3g} to {begin + phase.steps * phase.timestep:.3g} s"
    title = f"{phase.name}, {span}" if phase.name else span
    seeds = f"{phase.seeds} seed{'s' if phase.seeds > 1 else ''}"
    head = (
        f"{title}: {seeds}, {phase.windows} windows of {format_amount(phase.window, 'ms')}, steps "
        f"of {format_amount(phase.timestep, 'ms')}"
    )
    rows = [PlacedRow(row, begin) for row in phase.rows if row.exercised]
    drift = phase.energy_drift
    is_drifting = drift is None or abs(drift) >= LEAST_ERROR
    signed = format_percent(math.inf if drift is None else drift, signed=True)
    others = [f"energy drift {signed if is_drifting else '0 %'}"]
    if phase.upper_bound is not None:
        others.append(f"upper bound of the numerical error {share_text(phase.upper_bound)}")
    others.append(f"not judged: excess path {share_text(phase.excess_path)}")
    others.append(f"worst window {share_text(phase.worst_window)} of the body's largest speed")
    blocks: list[Block] = [
        Sentence(head),
        budget_table(PlacedRow(phase.numerical_error, begin), rows, tolerance),
        *_describe_unexercised([row.name for row in phase.rows if not row.exercised]),
        Sentence("; ".join(others)),
    ]
    return Section(tuple(blocks), "budget")


def worst_rows_section(budget: BudgetReport, task: Task) -> Section:
    """Return the numerical error and the rows that matter, each of its worst phase."""
    rows_by_name = largest_rows(budget, task)
    run = rows_by_name.pop(budget.phases[0].numerical_error.name)
    shown_share = 0.1  # of the tolerance: rows above it are in the short table
    least = shown_share * budget.tolerance
    large_rows = {name: at for name, at in rows_by_name.items() if row_error(at.row) >= least}
    blocks: list[Block] = [
        Sentence(DEFINITION),
        budget_table(run, list(large_rows.values()), budget.tolerance),
    ]
    if less := [name for name in rows_by_name if name not in large_rows]:
        blocks.append(Sentence(f"below {format_percent(least)}: {', '.join(less)}"))
    rows = dict.fromkeys(row.name for phase in budget.phases for row in phase.rows)
    blocks += _describe_unexercised([name for name in rows if name not in rows_by_name])
    return Section(tuple(blocks), "budget")


def budget_table(run: PlacedRow, rows: Sequence[PlacedRow], tolerance: float) -> Table:
    """Return the table of the numerical error and of exercised rows, by their kind."""
    built = [_table_row(run, "", tolerance)]
    for kind, group in _GROUPS.items():
        own = sorted(
            (placed for placed in rows if placed.row.kind == kind),
            key=lambda placed: -row_error(placed.row),
        )
        built += [_table_row(placed, group, tolerance) for placed in own]
    return Table(_HEADS, tuple(built), ruled=False)


def largest_rows(budget: BudgetReport, task: Task) -> dict[str, PlacedRow]:
    """Return the exercised rows, each from the phase where it is largest."""
    begins = phase_begins(task)
    largest: dict[str, PlacedRow] = {}
    for phase in budget.phases:
        for row in (phase.numerical_error, *phase.rows):
            largest_yet = largest.get(row.name)
            if row.exercised and (
                largest_yet is None or row_error(row) > row_error(largest_yet.row)
            ):
                largest[row.name] = PlacedRow(row, begins.get(phase.name, 0.0))
    return largest


def row_error(row: BudgetRow) -> float:
    """Return the error of a row; infinite if the engine failed, 0 if unknown."""
    return math.inf if row.infinite else row.error or 0.0


def phase_begins(task: Task) -> dict[str, float]:
    """Return when the phases of a task begin [s], by name."""
    return {phase.name: phase.begin for phase in task.phases}


def share_text(share: float | None) -> str:
    """Return a share of a report as text; null stands for infinity."""
    return format_percent(math.inf if share is None else share)


def _describe_unexercised(names: Sequence[str]) -> list[Block]:
    return [Sentence(f"not exercised by the task: {', '.join(names)}")] if names else []


def _table_row(placed: PlacedRow, group: str, tolerance: float) -> Row:
    row = placed.row
    error = math.inf if row.infinite else row.error
    spread = seeds_text(*row.seeds) if row.seeds and row.error is not None else ""
    when = "" if row.time is None else f", {placed.begin + row.time:.2f} s"
    exceeds = error is not None and error > tolerance
    text = format_above(error, tolerance) if error and exceeds else format_table_error(error)
    where = f"{row.body}{when}" if error is not None and error >= LEAST_ERROR else ""
    ratio = format_amount(row.time_ratio.ratio, "x") if row.time_ratio else ""
    is_judged = not group or row.kind in {"numerics", "model"}
    bar = Bar(_place_along_bar(error or 0.0), _place_along_bar(tolerance), exceeds and is_judged)
    return Row((row.name, text, spread, bar, ratio, where), group, title=row.summary)


def seeds_text(low: float, high: float) -> str:
    """Return the range of an error over seeds as text; "" if they are equal."""
    first, last = (format_table_error(value).removesuffix(" %") for value in (low, high))
    return "" if first == last else f"{first}-{last} %"


def _place_along_bar(share: float) -> float:
    """Return how far along a logarithmic bar a share is, 0 to 1."""
    least, most = 1e-3, 10.0  # ends: a tenth of a percent, and ten times the forces
    if share <= least:
        return 0.0
    return min(1.0, math.log(share / least) / math.log(most / least))
