"""An examination as lines of text for 80 columns."""

import math
import textwrap
from collections.abc import Iterator, Sequence
from itertools import chain

from contactlab.budget.verdict import percent
from contactlab.printable import visible
from contactlab.schema.drive import PolicyDrive
from contactlab.schema.error_budget import BudgetPhase, BudgetRemedy, BudgetRow
from contactlab.schema.examination import Examination, ModelChange
from contactlab.schema.task import Task

_WIDTH = 80
_RUN = "the run"
_SHARE, _SPREAD, _BAR, _COST = 7, 11, 8, 5
_HEADS = {"numerics": "numerics", "model": "model", "effect": "effects", "unknown": "unknowns"}
# Bars are logarithmic: one sign for a third of a decade, from a tenth of a percent on.
_LEAST, _PER_DECADE = 1e-3, 2
_NOTHING = 1e-4
_TOLD = 0.1  # of the tolerance: rows that a short table has
_REPLAYED = "What the policy did is replayed; whether its loop is stable is not judged."
_UNIT = (
    "Shares are phantom forces over the real ones, of the worst body; bars are logarithmic, from "
    "0.1 to 1000 %; cost is the time of a run with the change over one without."
)


def examination_lines(report: Examination, *, full: bool = False) -> list[str]:
    """Return the verdict, the task, the budget, facts, and the changes that help.

    In short, rows are those of the phase in which each is largest, above a tenth of the tolerance;
    in full, all rows of each phase and all changes that were tried.
    """
    lines = [*_wrapped(report.sentence, ""), *_wrapped(report.task.line, "")]
    if isinstance(report.task.drive, PolicyDrive):
        lines += _wrapped(_REPLAYED, "")
    lines.append("")
    if full:
        lines += _wrapped(_UNIT, "")
        for phase in report.budget.phases:
            lines += ["", *_phase(phase, report.task)]
        lines += _tried(report)
    else:
        lines += _short_budget(report)
    if report.facts:
        lines += ["", *chain.from_iterable(_wrapped(fact.sentence, "") for fact in report.facts)]
    for number, change in enumerate(report.changes, 1):
        lines += ["", *_change(number, change)]
    lines += ["", *_wrapped(_end(report), "")]
    return [visible(line) for line in lines]


def _short_budget(report: Examination) -> Iterator[str]:
    """Yield the run, and the rows that matter, each from the phase in which it is largest."""
    begins = _begins(report.task)
    found: dict[str, tuple[BudgetRow, float]] = {}
    for phase in report.budget.phases:
        for row in (phase.run, *phase.rows):
            kept = found.get(row.name)
            if row.exercised and (kept is None or _size(row) > _size(kept[0])):
                found[row.name] = row, begins.get(phase.name, 0.0)
    run, begin = found.pop(report.budget.phases[0].run.name)
    shown = [name for name, (row, _) in found.items() if _size(row) >= _TOLD * report.budget.within]
    names = 2 + max(map(len, (*shown, _RUN)))
    yield _cells(names, ("", "share", "seeds", "", "cost", "worst body, when"))
    yield _line(names, _RUN, run, begin)
    for kind, head in _HEADS.items():
        rows = [(name, *found[name]) for name in shown if found[name][0].kind == kind]
        if rows:
            yield f"{head}:"
        yield from (_line(names, f"  {name}", row, since) for name, row, since in rows)
    if less := [name for name in found if name not in shown]:
        yield from _wrapped(f"below {percent(_TOLD * report.budget.within)}: {', '.join(less)}", "")
    idle = {row.name: None for phase in report.budget.phases for row in phase.rows}
    if never := [name for name in idle if name not in found]:
        yield from _wrapped(f"never exercised: {', '.join(never)}", "")


def _size(row: BudgetRow) -> float:
    return math.inf if row.infinite else row.share or 0.0


def _begins(task: Task) -> dict[str, float]:
    return {phase.name: phase.begin for phase in task.phases}


def _change(number: int, change: ModelChange) -> Iterator[str]:
    kind = "another model" if change.physics else "the same model, computed otherwise"
    cost = f", at {change.price.ratio:.2f} times the time" if change.price else ""
    left = f", leaves {_share(change.share)}" if change.share is not None else ""
    yield from _wrapped(f"{number}. {change.name}: {kind}{left}{cost}", "")
    yield from (f"   {line}" for line in change.lines)
    if change.unwritten:
        yield from _wrapped(f"not written: {change.unwritten}", "   ")


def _end(report: Examination) -> str:
    if report.written:
        return f"the model with the first change: {report.written}"
    if any(change.lines for change in report.changes):
        return "changes were judged on fresh seeds too; --write FILE writes the first"
    if report.budget.remedies and not report.changes:
        names = ", ".join(remedy.name for remedy in report.budget.remedies)
        return f"no change that was tried removes it: {names}"
    return "--format full prints all rows of each phase"


def _tried(report: Examination) -> Iterator[str]:
    if report.budget.remedies:
        yield ""
        yield f"{'changes tried:':45} {'cost':>6} {'share':>7}"
        yield from map(_remedy, report.budget.remedies)


def _phase(phase: BudgetPhase, task: Task) -> Iterator[str]:
    begin = _begins(task).get(phase.name, 0.0)
    span = f"{begin:.3g} to {begin + phase.steps * phase.timestep:.3g} s"
    yield (
        f"{phase.name}, {span}: {phase.windows} windows of {1e3 * phase.window:.3g} ms, steps of "
        f"{1e3 * phase.timestep:.3g} ms"
    )
    used = [row for row in phase.rows if row.exercised]
    names = 2 + max((len(row.name) for row in used), default=len(_RUN))
    yield _cells(names, ("", "share", "seeds", "", "cost", "worst body, when"))
    yield _line(names, _RUN, phase.run, begin)
    for kind, head in _HEADS.items():
        rows = [row for row in used if row.kind == kind]
        if rows:
            yield f"{head}:"
        yield from (_line(names, f"  {row.name}", row, begin) for row in rows)
    if idle := [row.name for row in phase.rows if not row.exercised]:
        yield from _wrapped(f"never exercised: {', '.join(idle)}", "")
    yield from _wrapped(", ".join(_beside(phase)), "")


def _beside(phase: BudgetPhase) -> Iterator[str]:
    yield f"energy drift {_signed(phase.energy)}"
    if phase.check is not None and phase.run.share is not None:
        yield f"reference known to {_share(phase.check * phase.run.share)}"
    yield f"not judged: path excess {_share(phase.excess)}"
    yield f"worst window {_share(phase.peak)} of the body's peak speed"


def _line(names: int, name: str, row: BudgetRow, begin: float) -> str:
    share = math.inf if row.infinite else row.share
    spread = ""
    if row.seeds and row.share is not None:
        low, high = (_short(value).removesuffix(" %") for value in row.seeds)
        spread = "" if low == high else f"{low}-{high}"
    when = "" if row.time is None else f", {begin + row.time:.2f} s"
    where = f"{row.body}{when}" if share is not None and share >= _NOTHING else ""
    cost = f"x{row.price.ratio:.2f}" if row.price else ""
    return _cells(names, (name, _short(share), spread, _bar(share), cost, where))


def _cells(names: int, cells: tuple[str, str, str, str, str, str]) -> str:
    """Return a line of a table whose names take so many places."""
    name, share, spread, bar, cost, where = cells
    left = f"{name:{names}} {share:>{_SHARE}} {spread:>{_SPREAD}}  {bar:<{_BAR}} {cost:>{_COST}}  "
    return f"{left}{_within(where, _WIDTH - len(left))}".rstrip()


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


def _share(share: float | None) -> str:
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


def _remedy(remedy: BudgetRemedy) -> str:
    cost = f"x{remedy.price.ratio:.2f}" if remedy.price else ""
    end = "removes it" if remedy.removes else f"still {remedy.word}"
    share = "∞" if remedy.share is None else percent(remedy.share)
    return f"  {remedy.name:43} {cost:>6} {share:>7}  {end}"


def _wrapped(text: str, indent: str = "  ") -> Sequence[str]:
    return textwrap.wrap(
        text,
        _WIDTH,
        initial_indent=indent,
        subsequent_indent=f"{indent}  ",
        break_long_words=False,
        break_on_hyphens=False,
    )
