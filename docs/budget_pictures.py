"""Draw the picture of docs/how-to/budget.md, and print its table.

Run: python -m docs.budget_pictures [FOLDER]

FOLDER has gymnasium's models (gymnasium/envs/mujoco/assets), with the ant. The installed package
is used by default.
"""

import sys
from pathlib import Path

import altair as alt
import mujoco
from bench.budget import assets, driven_by_sines

from contactlab.budget import (
    ErrorBudget,
    budget_report,
    error_budget,
    judge,
)
from contactlab.charts import Rows, halo_layers, layer_of, save_figure, word_colours
from contactlab.palette import COLOURS, INK
from contactlab.rendering.text import render_text
from contactlab.reporting.budget_document import describe_budget
from contactlab.schema.error_budget import BudgetRow

_FOLDER = Path(__file__).parent / "pictures"
_KINDS = "numerics", "model", "effect", "unknown"
_LEAST, _MOST = 1e-3, 30.0  # shares that the axis shows
_WIDTH, _STEP, _NAMES = 380, 18, 110  # pixels


def main() -> None:
    """Draw the budget of an ant."""
    ant = mujoco.MjModel.from_xml_path(str(assets() / "ant.xml"))
    budget = error_budget([driven_by_sines(ant, 2.0, 3)])
    draw(budget, "budget-ant.svg", "An ant that tumbles (RK4 at 10 ms)")


def draw(budget: ErrorBudget, file: str, title: str) -> None:
    """Write the picture of a budget's first phase."""
    verdict = judge(budget)
    phase = budget_report(budget, verdict).phases[0]
    exercised = (row for row in phase.rows if row.exercised and (row.error or 0) > _LEAST)
    shown = [phase.numerical_error, *exercised]
    rows = [bar_of(row) for row in sorted(shown, key=lambda row: _KINDS.index(row.kind))]
    subtitle = (
        f"{verdict.word} (tolerance 10 %, dashed): residual force over real forces, worst body"
    )
    chart = chart_of(rows).properties(title=alt.Title(title, subtitle=subtitle))
    save_figure(chart, _FOLDER / file)
    text = render_text(describe_budget(budget_report(budget, verdict)))
    sys.stdout.write(f"{text}\n\n")


def bar_of(row: BudgetRow) -> dict[str, object]:
    """Return a row as a bar: its error, its least and largest seed, and its worst body."""
    error = row.error or 0.0
    low, high = row.seeds or (error, error)
    return {
        "row": row.name,
        "kind": row.kind,
        "from": _LEAST,
        "error": min(error, _MOST),
        "low": max(low, _LEAST),
        "high": min(high, _MOST),
        "body": row.body,
    }


def chart_of(rows: Rows) -> alt.LayerChart | alt.FacetChart:
    """Return bars over a logarithmic axis, with seeds as whiskers and the tolerance as a line."""
    names = [row["row"] for row in rows]
    across = alt.Y("row:N").sort(names).title(None).axis(minExtent=_NAMES)
    axis = alt.Axis(format="%", values=[1e-3, 1e-2, 0.1, 1, 10], title="error")
    along = alt.X("from:Q").scale(type="log", domain=[_LEAST, _MOST]).axis(axis)
    base = layer_of("rows", rows).encode(y=across)
    colour = word_colours("kind", _KINDS, COLOURS[: len(_KINDS)])
    bars = base.mark_bar(height=_STEP - 6).encode(x=along, x2="error:Q", color=colour)
    seeds = base.mark_rule(color=INK).encode(x=alt.X("low:Q"), x2="high:Q")
    bodies = base.encode(x="high:Q", text="body:N")
    texts = halo_layers(bodies, align="left", dx=5, fontSize=10)
    line = layer_of("tolerance", [{"error": 0.1}]).mark_rule(color=INK, strokeDash=[4, 3])
    tolerance = line.encode(x="error:Q")
    return alt.layer(bars, tolerance, seeds, *texts).properties(
        width=_WIDTH, height=alt.Step(_STEP)
    )


if __name__ == "__main__":
    main()
