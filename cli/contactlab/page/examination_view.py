"""The part of a page about an examination: its worst moment, budget, fixes and checks."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import altair as alt

from contactlab.charts import (
    Rows,
    Spec,
    apply_theme,
    halo_layers,
    layer_of,
    static_svg,
    word_colours,
)
from contactlab.page.header_films import Films, HeaderFilm, Moment, film_in, film_of_moment
from contactlab.palette import COLOURS, OTHERS_COLOUR
from contactlab.rendering.document import Document
from contactlab.rendering.html import render_html
from contactlab.reporting.budget_document import phase_begins
from contactlab.reporting.examination import judged_labels
from contactlab.reporting.examination_document import describe_examination
from contactlab.schema.error_budget import BudgetReport
from contactlab.schema.examination import Examination
from contactlab.store.finished_store import Store

_REMOVES, _REMAINS, _NOW = "removes the cause", "does not", "as written"


@dataclass(frozen=True)
class ExaminationView:
    """An examination, as a page shows it.

    Attributes:
        report: the whole.
        film: of the worst moment, or why it is missing.
        grip: a film of the grip that is a fact; None without one.
        document: what its text says.
        chart: time over error of the fixes that were tried; empty without any.
    """

    report: Examination
    film: Films
    grip: HeaderFilm | None
    document: Document
    chart: str

    def html(self, section: str) -> str:
        """Return the sections of a name as HTML; empty if there are none."""
        return render_html(self.document.section(section))

    @property
    def has_pictures(self) -> bool:
        """Whether a film stands next to the budget, which has the whole width otherwise."""
        return bool(self.film.films or self.grip)

    @property
    def verdict(self) -> str:
        """The CSS class of its headline: ok, depends on a modeling choice, or neither."""
        if not self.report.passed:
            return "unmet"
        return "softly" if self.report.verdict == "depends" else "met"


def examination_view(
    store: Store, report: Examination | None, grip: Path | None = None
) -> ExaminationView | None:
    """Return the part of a page for an examination of a store's runs; None without one.

    The page has a film of its grip if one was drawn.
    """
    if report is None:
        return None
    budget = report.budget
    moment = None if budget is None else choose_moment(store, report, budget)
    chart = None if budget is None else _fix_chart(budget)
    return ExaminationView(
        report=report,
        film=Films([]) if moment is None else film_of_moment(store, moment),
        grip=None if grip is None else film_in(grip, "the hand closes"),
        # A page does not name its own file.
        document=describe_examination(report.model_copy(update={"page": None}), details=True),
        chart=static_svg(chart, "Error over time of the fixes that were tried") if chart else "",
    )


def choose_moment(store: Store, report: Examination, budget: BudgetReport) -> Moment | None:
    """Return the moment of an examination to film; None if no run of the store has it.

    If the model fails by a label, that is its begin. Otherwise it is the worst window of the first
    reason, or of the numerical error.
    """
    seeds = dict(zip(*(store.table[name].to_pylist() for name in ("seed", "run_id")), strict=True))
    if report.verdict == "fails":
        for label in judged_labels(report):
            if label.time is not None and label.bodies and label.seed in seeds:
                body, begin = label.bodies[0], label.time
                end = begin + budget.phases[0].window
                words = f"{label.label}: {body}, {begin:.2f} s, seed {label.seed}"
                return Moment(seeds[label.seed], body, begin, end, words)
    if budget.reasons:
        reason = budget.reasons[0]
        phase = next(each for each in budget.phases if each.name == reason.phase)
        rows = {row.name: row for row in phase.rows}
        row = rows.get(reason.row, phase.numerical_error)
    else:
        phase = max(budget.phases, key=lambda phase: phase.numerical_error.error or 0.0)
        row = phase.numerical_error
    if row.time is None or row.seed is None or row.body is None:
        return None
    seed = report.task.seeds[min(row.seed, len(report.task.seeds) - 1)]
    begin = phase_begins(report.task).get(phase.name, 0.0) + row.time
    if seed not in seeds:
        return None
    words = f"the worst moment: {row.body}, {begin:.2f} s, seed {seed}"
    return Moment(seeds[seed], row.body, begin, begin + phase.window, words)


def _fix_chart(budget: BudgetReport) -> Spec | None:
    """Return the chart of the fixes that were tried: the error that is left, over the time."""
    reason = budget.reasons[0].error if budget.reasons else None
    rows: Rows = [
        {
            "name": fix.name,
            "time": fix.time_ratio.ratio,
            "error": fix.error,
            "kind": _REMOVES if fix.removes else _REMAINS,
        }
        for fix in budget.fixes
        if fix.time_ratio and fix.error
    ]
    if not rows or not reason:
        return None
    rows.append({"name": _NOW, "time": 1.0, "error": abs(reason), "kind": _NOW})
    colours: Mapping[str, str] = {_NOW: COLOURS[2], _REMOVES: COLOURS[0], _REMAINS: OTHERS_COLOUR}
    times = [row["time"] for row in rows]
    margin = 1.5  # room for names next to the fastest and the slowest, as a ratio of times
    domain = min(times) / margin, max(times) * margin
    ticks = [
        float(f"{digits}e{power}") for power in range(-5, 3) for digits in (1, 1.5, 2, 3, 5, 7)
    ]
    layer = layer_of("tried", rows).encode(
        x=alt.X(
            "time:Q", title="time of a simulated second, over that of the model as written"
        ).scale(type="log", nice=False, domain=domain),
        y=alt.Y("error:Q", title="error that is left")
        .scale(type="log", nice=False, padding=25)
        .axis(format="~%", values=ticks),
    )
    points = layer.mark_point(filled=True, size=110, opacity=1).encode(
        color=word_colours("kind", list(colours), list(colours.values()))
        .title(None)
        .legend(orient="bottom")
    )
    # Fixes that do not help crowd around the model as written.
    labeled_rows = [row for row in rows if row["kind"] != _REMAINS]
    labeled_rows.sort(key=lambda row: row["error"])
    texts = list[alt.Chart]()
    # Below and above in turns, the least error below: two similar fixes lie next to each other.
    for place, (part, above) in enumerate((("named_below", 18), ("named", -12))):
        words = layer_of(part, labeled_rows[place::2]).encode(
            x=layer.encoding.x, y=layer.encoding.y, text="name:N"
        )
        texts += halo_layers(words, dy=above, fontSize=11)
    limit = (
        layer_of("limit", [{"error": budget.tolerance}])
        .mark_rule(strokeDash=[6, 4])
        .encode(y="error:Q")
    )
    chart = alt.layer(limit, points, *texts).properties(width=520, height=260)
    return apply_theme(chart.to_dict(validate=False))
