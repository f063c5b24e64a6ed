"""A panel on a terminal."""

from collections.abc import Iterator

from contactlab.schema.engine_panel import EnginePanel, PanelRun
from contactlab.studies.engine_panel.engine_panel import better, middle


def rows(panel: EnginePanel) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return a table of errors and CPU time of a step: a row a task, a column an engine."""
    header = ("task", "step, ms", *panel.engines)
    table: list[tuple[str, ...]] = []
    for task in panel.tasks:
        runs = [middle(panel, task.name, engine) for engine in panel.engines]
        step = next((f"{1e3 * run.step:g}" for run in runs if run), "-")
        table.append((f"{task.name}: {task.measure}", step, *map(_cell, runs)))
    return header, table


def notes(panel: EnginePanel) -> Iterator[str]:
    """Yield who is better than MuJoCo, and what was left out."""
    for first, ours in better(panel):
        yield f"{first.task}: {first.engine} {first.error:.2g}, mujoco {ours.error:.2g}"
    yield from panel.left_out


def _cell(run: PanelRun | None) -> str:
    if run is None:
        return ""
    if run.error is None:
        return run.label
    return f"{run.error:.2g}" + (f", {1e6 * run.cost * run.step:.2g} us" if run.cost else "")
