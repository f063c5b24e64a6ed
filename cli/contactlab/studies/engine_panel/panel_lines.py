"""The panel as text."""

from collections.abc import Iterator

from contactlab.schema.engine_panel import EnginePanel, PanelRun
from contactlab.studies.engine_panel.engine_panel import better_runs, middle_run


def rows(panel: EnginePanel) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return the table of errors and CPU time of a step, by task and engine."""
    header = ("task", "step, ms", *panel.engines)
    table: list[tuple[str, ...]] = []
    for task in panel.tasks:
        runs = [middle_run(panel, task.name, engine) for engine in panel.engines]
        step = next((f"{1e3 * run.step:g}" for run in runs if run), "-")
        table.append((f"{task.name}: {task.measure}", step, *map(_cell, runs)))
    return header, table


def notes(panel: EnginePanel) -> Iterator[str]:
    """Yield the engines that are better than MuJoCo, and the skipped ones."""
    for first, ours in better_runs(panel):
        yield f"{first.task}: {first.engine} {first.error:.2g}, mujoco {ours.error:.2g}"
    yield from panel.skipped


def _cell(run: PanelRun | None) -> str:
    if run is None:
        return ""
    if run.error is None:
        return run.label
    return f"{run.error:.2g}" + (f", {1e6 * run.cost * run.step:.2g} us" if run.cost else "")
