"""The part of a page that tells an examination: its worst moment, budget, changes and checks."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import altair as alt

from contactlab.charts import Rows, Spec, haloed, layer_of, static_svg, themed, word_colours
from contactlab.page.header_films import Films, HeaderFilm, Moment, film_in, film_of_moment
from contactlab.palette import COLOURS, OTHERS_COLOUR
from contactlab.printable import percent
from contactlab.reporting.examination import (
    change_line,
    grouped_contacts,
    largest_rows,
    phase_begins,
    row_size,
    untried_line,
)
from contactlab.schema.error_budget import BudgetPhase, BudgetReport, BudgetRow
from contactlab.schema.examination import Examination
from contactlab.store.finished_store import Store

# Bars are logarithmic, from a tenth of a percent to ten times the real forces.
_LEAST, _MOST = 1e-3, 10.0
_TOLD = 0.1  # of the tolerance: rows that are shown
_KINDS = {"numerics": "numerics", "model": "model", "effect": "effects", "unknown": "unknowns"}
_TICKS = [float(f"{digits}e{power}") for power in range(-5, 3) for digits in (1, 1.5, 2, 3, 5, 7)]
_BESIDE = 1.5  # room for words beside the fastest and the slowest, as a ratio of times
_REMOVES, _REMAINS, _NOW = "removes the cause", "does not", "as written"


@dataclass(frozen=True)
class BudgetLine:
    """A row of the budget: texts, and its bar as shares of the full width, 0 to 1."""

    name: str
    kind: str
    share: str
    spread: str
    bar: float
    exceeds: bool
    cost: str
    where: str
    summary: str


@dataclass(frozen=True)
class ExaminationView:
    """An examination, as a page tells it.

    Attributes:
        report: the whole.
        film: of the worst moment, or why there is none.
        grip: a film of the grip that a fact tells of; None without one.
        lines: the rows of the budget that are told, the run first.
        limit: where the tolerance is along a bar, 0 to 1.
        chart: time over error of what was tried; empty if nothing was.
        changes: each in a line, with the lines of the model's files.
        untried: what there was no time for, in a sentence; empty if nothing.
        contacts: each as lines of text.
    """

    report: Examination
    film: Films
    grip: HeaderFilm | None
    lines: Sequence[BudgetLine]
    limit: float
    chart: str
    changes: Sequence[tuple[str, Sequence[str]]]
    untried: str
    contacts: Sequence[Sequence[str]]

    @property
    def has_pictures(self) -> bool:
        """Whether a film stands beside the budget, which has the width otherwise."""
        return bool(self.film.drawn or self.grip)

    @property
    def verdict(self) -> str:
        """The class of its headline: sound, decided by softness, or neither."""
        if not self.report.sound:
            return "unmet"
        soft = self.report.budget is not None and self.report.budget.verdict == "model"
        return "softly" if soft else "met"


def examination_view(
    store: Store, report: Examination | None, grip: Path | None = None
) -> ExaminationView | None:
    """Return the part of a page for an examination whose runs a store has; None without one.

    The page has a film of its grip if one was drawn.
    """
    if report is None:
        return None
    budget = report.budget
    moment = None if budget is None else _worst_moment(store, report, budget)
    chart = None if budget is None else _tried(budget)
    return ExaminationView(
        report=report,
        film=Films([]) if moment is None else film_of_moment(store, moment),
        grip=None if grip is None else film_in(grip, "the hand closes"),
        lines=[] if budget is None else list(_lines(report, budget)),
        limit=_along(report.task.within),
        chart=static_svg(chart, "Error over time of what was tried") if chart else "",
        changes=[
            (change_line(number, change), change.lines or (change.unwritten,))
            for number, change in enumerate(report.changes, 1)
        ],
        untried=untried_line(report),
        contacts=grouped_contacts(report.contacts),
    )


def _worst_moment(store: Store, report: Examination, budget: BudgetReport) -> Moment | None:
    """Return the worst window of what the verdict names; of the run, where it is sound."""
    phase, row = _worst_row(budget)
    if row.time is None or row.seed is None or row.body is None:
        return None
    seeds = dict(zip(*(store.table[name].to_pylist() for name in ("seed", "run_id")), strict=True))
    seed = report.task.seeds[min(row.seed, len(report.task.seeds) - 1)]
    begin = phase_begins(report.task).get(phase.name, 0.0) + row.time
    if seed not in seeds:
        return None
    words = f"the worst moment: {row.body}, {begin:.2f} s, seed {seed}"
    return Moment(seeds[seed], row.body, begin, begin + phase.window, words)


def _worst_row(budget: BudgetReport) -> tuple[BudgetPhase, BudgetRow]:
    phases = {phase.name: phase for phase in budget.phases}
    for reason in budget.reasons:
        phase = phases[reason.phase]
        rows = {row.name: row for row in phase.rows}
        return phase, rows.get(reason.row, phase.run)
    worst = max(budget.phases, key=lambda phase: phase.run.share or 0.0)
    return worst, worst.run


def _lines(report: Examination, budget: BudgetReport) -> Iterator[BudgetLine]:
    found = largest_rows(budget, report.task)
    run, *_ = found
    told = [name for name in found if row_size(found[name][0]) >= _TOLD * budget.within]
    kinds = list(_KINDS)
    told.sort(key=lambda name: kinds.index(found[name][0].kind))
    for name in dict.fromkeys((run, *told)):
        row, begin = found[name]
        share = row_size(row)
        when = "" if row.time is None else f", {begin + row.time:.2f} s"
        yield BudgetLine(
            name="the run" if name == run else name,
            kind="" if name == run else _KINDS[row.kind],
            share=percent(share),
            spread="" if row.seeds is None else " to ".join(map(percent, row.seeds)),
            bar=_along(share),
            exceeds=row.kind in {"numerics", "model"} and share > budget.within,
            cost=f"x {row.price.ratio:.2f}" if row.price else "",
            where=f"{row.body or ''}{when}",
            summary=row.summary,
        )


def _along(share: float) -> float:
    """Return how far along a bar a share is, 0 to 1."""
    if share <= _LEAST:
        return 0.0
    return min(1.0, math.log(share / _LEAST) / math.log(_MOST / _LEAST))


def _tried(budget: BudgetReport) -> Spec | None:
    """Return the chart of what was tried: what is left of the error, over the time it takes."""
    reason = budget.reasons[0].share if budget.reasons else None
    rows: Rows = [
        {
            "name": remedy.name,
            "time": remedy.price.ratio,
            "error": remedy.share,
            "kind": _REMOVES if remedy.removes else _REMAINS,
        }
        for remedy in budget.remedies
        if remedy.price and remedy.share
    ]
    if not rows or not reason:
        return None
    rows.append({"name": _NOW, "time": 1.0, "error": abs(reason), "kind": _NOW})
    return themed(_specification(rows, budget.within).to_dict())


def _specification(rows: Rows, within: float) -> alt.TopLevelMixin:
    colours: Mapping[str, str] = {_NOW: COLOURS[2], _REMOVES: COLOURS[0], _REMAINS: OTHERS_COLOUR}
    times = [row["time"] for row in rows]
    shown = min(times) / _BESIDE, max(times) * _BESIDE
    layer = layer_of("tried", rows).encode(
        x=alt.X(
            "time:Q", title="time of a simulated second, over that of the model as written"
        ).scale(type="log", nice=False, domain=shown),
        y=alt.Y("error:Q", title="error that is left")
        .scale(type="log", nice=False, padding=25)
        .axis(format="~%", values=_TICKS),
    )
    points = layer.mark_point(filled=True, size=110, opacity=1).encode(
        color=word_colours("kind", list(colours), list(colours.values()))
        .title(None)
        .legend(orient="bottom")
    )
    # Those that do not help crowd about the model as written.
    named = [row for row in rows if row["kind"] != _REMAINS]
    named.sort(key=lambda row: row["error"])
    texts = list[alt.Chart]()
    # Below and above in turns, the least error below: two that are alike lie beside each other.
    for place, (part, above) in enumerate((("named_below", 18), ("named", -12))):
        words = layer_of(part, named[place::2]).encode(
            x=layer.encoding.x, y=layer.encoding.y, text="name:N"
        )
        texts += haloed(words, dy=above, fontSize=11)
    limit = layer_of("limit", [{"error": within}]).mark_rule(strokeDash=[6, 4]).encode(y="error:Q")
    return alt.layer(limit, points, *texts).properties(width=520, height=260)
