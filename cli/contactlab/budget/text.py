"""A budget as lines of text for 80 columns."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from contactlab.budget.readings import ErrorBudget
from contactlab.budget.report import budget_report
from contactlab.budget.verdict import Verdict, percent_above
from contactlab.printable import COLUMNS, visible, wrapped
from contactlab.rendering.amounts import format_percent
from contactlab.schema.error_budget import BudgetPhase, BudgetReason, BudgetRow

_ERROR, _SPREAD, _BAR, _RATIO = 7, 12, 8, 5
_HEADS = {
    "numerics": "numerical settings, if changed:",
    "model": "modeling choices, if changed:",
    "effect": "effects, if left out:",
    "unknown": "uncertain parameters, if varied:",
}
# Bars are logarithmic: one sign for half a decade, from a tenth of a percent on.
_LEAST, _PER_DECADE = 1e-3, 2
_NOTHING = 1e-4
DEFINITION = "error budget: residual force as a share of the real forces, in the worst body"
NOTES = (
    "Bars are logarithmic, from 0.1 to 1000 %. The time is that of a run with the change over one "
    "without."
)


class Placed(NamedTuple):
    """A row of a table, and when its phase begins [s]; times count from the start of the run."""

    row: BudgetRow
    begin: float = 0.0


def budget_lines(budget: ErrorBudget, verdict: Verdict) -> list[str]:
    """Return a verdict with its reasons, and the table of each phase."""
    report = budget_report(budget, verdict)
    lines = [f"{report.verdict} (tolerance {format_percent(report.tolerance)})"]
    for reason in report.reasons:
        lines += wrapped(f"{reason.sentence}{_where(reason)}", "  ")
    for phase in report.phases:
        lines += ["", *phase_lines(phase, 0.0, report.tolerance)]
    return [visible(line) for line in lines]


def _where(reason: BudgetReason) -> str:
    place = "" if reason.place in reason.sentence else reason.place
    time = "" if reason.time is None else f"at {reason.time:.3g} s"
    return "".join(f", {part}" for part in (place, time) if part)


def phase_lines(phase: BudgetPhase, begin: float, tolerance: float) -> Iterator[str]:
    """Yield the budget of a phase that begins at a time [s], with numbers that are not judged."""
    span = f"{begin:.3g} to {begin + phase.steps * phase.timestep:.3g} s"
    title = f"{phase.name}, {span}" if phase.name else span
    seeds = f"{phase.seeds} seed{'s' if phase.seeds > 1 else ''}"
    yield from wrapped(
        f"{title}: {seeds}, {phase.windows} windows of {1e3 * phase.window:.3g} ms, steps of "
        f"{1e3 * phase.timestep:.3g} ms",
        "",
    )
    rows = [Placed(row, begin) for row in phase.rows if row.exercised]
    yield from table_lines(Placed(phase.numerical_error, begin), rows, tolerance)
    yield from unexercised_lines([row.name for row in phase.rows if not row.exercised])
    yield from wrapped("; ".join(_other_numbers(phase)), "")


def table_lines(run: Placed, rows: Sequence[Placed], tolerance: float) -> Iterator[str]:
    """Yield the table of the numerical error and of exercised rows, by their kind."""
    names = max(len(run.row.name), *(2 + len(row.name) for row, _ in rows)) if rows else 15
    yield _cells(names, ("", "error", "over seeds", "", "time", "worst body, when"))
    yield _line(names, run.row.name, run, tolerance)
    for kind, head in _HEADS.items():
        own = [placed for placed in rows if placed.row.kind == kind]
        own.sort(key=lambda placed: -_size(placed.row))
        if own:
            yield head
        yield from (_line(names, f"  {placed.row.name}", placed, tolerance) for placed in own)


def unexercised_lines(names: Sequence[str]) -> list[str]:
    """Return the rows that a task never exercises, as lines."""
    return wrapped(f"not exercised by the task: {', '.join(names)}", "") if names else []


def _other_numbers(phase: BudgetPhase) -> Iterator[str]:
    yield f"energy drift {_signed(phase.energy_drift)}"
    if phase.upper_bound is not None:
        yield f"upper bound of the numerical error {share_text(phase.upper_bound)}"
    yield f"not judged: excess path {share_text(phase.excess_path)}"
    yield f"worst window {share_text(phase.worst_window)} of the body's largest speed"


def _size(row: BudgetRow) -> float:
    return math.inf if row.infinite else row.error or 0.0


def _line(names: int, name: str, placed: Placed, tolerance: float) -> str:
    row = placed.row
    error = math.inf if row.infinite else row.error
    spread = ""
    if row.seeds and row.error is not None:
        low, high = (_short(value).removesuffix(" %") for value in row.seeds)
        spread = "" if low == high else f"{low}-{high} %"
    when = "" if row.time is None else f", {placed.begin + row.time:.2f} s"
    where = f"{row.body}{when}" if error is not None and error >= _NOTHING else ""
    ratio = f"x{row.time_ratio.ratio:.2f}" if row.time_ratio else ""
    exceeds = error is not None and error > tolerance
    text = percent_above(error, tolerance) if error and exceeds else _short(error)
    return _cells(names, (name, text, spread, _bar(error), ratio, where))


def _cells(names: int, cells: tuple[str, str, str, str, str, str]) -> str:
    name, error, spread, bar, ratio, where = cells
    left = (
        f"{name:{names}} {error:>{_ERROR}} {spread:>{_SPREAD}}  {bar:<{_BAR}} {ratio:>{_RATIO}}  "
    )
    return f"{left}{_shorten_middle(where, COLUMNS - len(left))}".rstrip()


def _shorten_middle(where: str, width: int) -> str:
    if len(where) <= width:
        return where
    name, comma, when = where.rpartition(", ")
    return f"{name[: width - len(comma + when) - 1]}…{comma}{when}" if comma else where[:width]


def _short(share: float | None) -> str:
    """Return a share in at most two digits; a share below a hundredth of a percent is 0."""
    if share is None:
        return "-"
    return "0 %" if share < _NOTHING else format_percent(share)


def share_text(share: float | None) -> str:
    """Return a share of a report, in which infinite shares are null."""
    return "∞" if share is None else format_percent(share)


def _signed(share: float | None) -> str:
    if share is None:
        return "∞"
    return "0 %" if abs(share) < _NOTHING else format_percent(share, signed=True)


def _bar(share: float | None) -> str:
    if share is None or share <= _LEAST:
        return ""
    if math.isinf(share):
        return "#" * _BAR
    return "#" * min(_BAR, max(1, round(_PER_DECADE * math.log10(share / _LEAST))))
