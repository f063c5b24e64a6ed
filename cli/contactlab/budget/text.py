"""A budget as lines of text for 80 columns."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from contactlab.budget.readings import ErrorBudget
from contactlab.budget.report import budget_report
from contactlab.budget.verdict import Verdict, percent
from contactlab.printable import COLUMNS, visible, wrapped
from contactlab.schema.error_budget import BudgetPhase, BudgetReason, BudgetRow

_RUN = "the run"
_SHARE, _SPREAD, _BAR, _COST = 7, 11, 8, 5
_HEADS = {"numerics": "numerics", "model": "model", "effect": "effects", "unknown": "unknowns"}
# Bars are logarithmic: one sign for half a decade, from a tenth of a percent on.
_LEAST, _PER_DECADE = 1e-3, 2
_NOTHING = 1e-4
UNIT = (
    "Shares are phantom forces over the real ones, of the worst body; bars are logarithmic, from "
    "0.1 to 1000 %; cost is the time of a run with the change over one without."
)


class Placed(NamedTuple):
    """A row of a table, and when its phase begins [s]: times count from the run's beginning."""

    row: BudgetRow
    begin: float = 0.0


def budget_lines(budget: ErrorBudget, verdict: Verdict) -> list[str]:
    """Return a verdict with its reasons, and a table of each phase."""
    report = budget_report(budget, verdict)
    lines = [f"{report.verdict} within {percent(report.within)}"]
    for reason in report.reasons:
        lines += wrapped(f"{reason.sentence}{_where(reason)}", "  ")
    for phase in report.phases:
        lines += ["", *phase_lines(phase)]
    return [visible(line) for line in lines]


def _where(reason: BudgetReason) -> str:
    place = "" if reason.place in reason.sentence else reason.place
    time = "" if reason.time is None else f"at {reason.time:.3g} s"
    return "".join(f", {part}" for part in (place, time) if part)


def phase_lines(phase: BudgetPhase, begin: float = 0.0) -> Iterator[str]:
    """Yield the budget of a phase that begins at a time [s]: its rows, and what judges nothing."""
    span = f"{begin:.3g} to {begin + phase.steps * phase.timestep:.3g} s"
    title = f"{phase.name}, {span}" if phase.name else span
    seeds = f"{phase.seeds} seed{'s' if phase.seeds > 1 else ''}"
    yield from wrapped(
        f"{title}: {seeds}, {phase.windows} windows of {1e3 * phase.window:.3g} ms, steps of "
        f"{1e3 * phase.timestep:.3g} ms",
        "",
    )
    rows = [Placed(row, begin) for row in phase.rows if row.exercised]
    yield from table_lines(Placed(phase.run, begin), rows)
    yield from never_lines([row.name for row in phase.rows if not row.exercised])
    yield from wrapped(", ".join(_beside(phase)), "")


def table_lines(run: Placed, rows: Sequence[Placed]) -> Iterator[str]:
    """Yield the table of the run and of exercised rows, by their kind."""
    names = 2 + max(map(len, (_RUN, *(row.name for row, _ in rows))))
    yield _cells(names, ("", "share", "seeds", "", "cost", "worst body, when"))
    yield _line(names, _RUN, run)
    for kind, head in _HEADS.items():
        own = [placed for placed in rows if placed.row.kind == kind]
        if own:
            yield f"{head}:"
        yield from (_line(names, f"  {placed.row.name}", placed) for placed in own)


def never_lines(names: Sequence[str]) -> list[str]:
    """Return which rows a task never exercises."""
    return wrapped(f"never exercised: {', '.join(names)}", "") if names else []


def _beside(phase: BudgetPhase) -> Iterator[str]:
    yield f"energy drift {_signed(phase.energy)}"
    if phase.most is not None:
        yield f"as far as references are known at most {share_text(phase.most)}"
    yield f"not judged: path excess {share_text(phase.excess)}"
    yield f"worst window {share_text(phase.peak)} of the body's peak speed"


def _line(names: int, name: str, placed: Placed) -> str:
    row = placed.row
    share = math.inf if row.infinite else row.share
    spread = ""
    if row.seeds and row.share is not None:
        low, high = (_short(value).removesuffix(" %") for value in row.seeds)
        spread = "" if low == high else f"{low}-{high}"
    when = "" if row.time is None else f", {placed.begin + row.time:.2f} s"
    where = f"{row.body}{when}" if share is not None and share >= _NOTHING else ""
    cost = f"x{row.price.ratio:.2f}" if row.price else ""
    return _cells(names, (name, _short(share), spread, _bar(share), cost, where))


def _cells(names: int, cells: tuple[str, str, str, str, str, str]) -> str:
    """Return a line of a table whose names take so many places."""
    name, share, spread, bar, cost, where = cells
    left = f"{name:{names}} {share:>{_SHARE}} {spread:>{_SPREAD}}  {bar:<{_BAR}} {cost:>{_COST}}  "
    return f"{left}{_within(where, COLUMNS - len(left))}".rstrip()


def _within(where: str, width: int) -> str:
    """Shorten a name in its middle, so that the time after it stays."""
    if len(where) <= width:
        return where
    name, comma, when = where.rpartition(", ")
    return f"{name[: width - len(comma + when) - 1]}…{comma}{when}" if comma else where[:width]


def _short(share: float | None) -> str:
    """Return a share in at most two digits; what is below a hundredth of a percent is nothing."""
    if share is None:
        return "-"
    return "0 %" if share < _NOTHING else percent(share)


def share_text(share: float | None) -> str:
    """Return a share of a report, in which infinite ones are null."""
    return "∞" if share is None else percent(share)


def _signed(share: float | None) -> str:
    if share is None:
        return "∞"
    return "0 %" if abs(share) < _NOTHING else f"{'+' if share > 0 else '-'}{percent(abs(share))}"


def _bar(share: float | None) -> str:
    if share is None or share <= _LEAST:
        return ""
    if math.isinf(share):
        return "#" * _BAR
    return "#" * min(_BAR, max(1, round(_PER_DECADE * math.log10(share / _LEAST))))
