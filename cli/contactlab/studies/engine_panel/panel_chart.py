"""The figure of a panel: error over CPU time, one plot per task."""

import altair as alt

from contactlab.charts import layer_of
from contactlab.schema.engine_panel import EnginePanel


def chart_panel(panel: EnginePanel) -> alt.TopLevelMixin:
    """Return the chart of errors over the CPU time of one simulated second."""
    few = alt.Axis(format="~e", tickCount=4, grid=False, labelOverlap=True)
    x = alt.X("cost:Q", scale=alt.Scale(type="log"), title="CPU s for 1 s", axis=few)
    y = alt.Y("error:Q", scale=alt.Scale(type="log"), title="error", axis=few)
    colour = alt.Color("engine:N", sort=list(panel.engines))
    charts: list[alt.LayerChart | alt.FacetChart] = []
    least_error = 1e-9  # error that the picture shows
    for task in panel.tasks:
        rows = [
            {"engine": run.engine, "cost": run.cost, "error": max(run.error, least_error)}
            for run in panel.runs
            if run.task == task.name and run.cost and run.error is not None
        ]
        lines = layer_of(task.name, rows).mark_line(point=True).encode(x, y, colour)
        title = f"{task.name}: {task.measure}"
        charts.append(alt.layer(lines).properties(width=190, height=130, title=title))
    columns = 3
    return alt.concat(*charts, columns=columns)
