"""Describes a panel of engines: errors and CPU time of a step, by task and engine."""

from pathlib import Path

from contactlab.rendering.amounts import format_amount
from contactlab.rendering.document import Code, Document, Sentence, document_of, table_of
from contactlab.schema.engine_panel import REPORT, EnginePanel, PanelRun
from contactlab.studies.engine_panel.engine_panel import better_runs, middle_run


def describe_panel(panel: EnginePanel, *, folder: Path | None = None) -> Document:
    """Describe engines on tasks with a closed form.

    Args:
        panel: the engines and their runs.
        folder: of the report, if it was written.
    """
    rows: list[tuple[str, ...]] = []
    for task in panel.tasks:
        runs = [middle_run(panel, task.name, engine) for engine in panel.engines]
        step = next((f"{1e3 * run.step:g}" for run in runs if run), "-")
        rows.append((f"{task.name}: {task.measure}", step, *map(_run_cell, runs)))
    better = [
        Sentence(f"{first.task}: {first.engine} {first.error:.2g}, mujoco {ours.error:.2g}")
        for first, ours in better_runs(panel)
    ]
    place = f"all steps, depths and labels: {folder / REPORT}" if folder else ""
    return document_of(
        [
            Sentence(", ".join(f"{name} {version}" for name, version in panel.engines.items())),
            table_of(("task", "step, ms", *panel.engines), rows),
            *better,
            *map(Sentence, panel.skipped),
            *([Code((place,), indent=0)] if place else []),
        ]
    )


def _run_cell(run: PanelRun | None) -> str:
    if run is None:
        return ""
    if run.error is None:
        return run.label
    time = f", {format_amount(run.cost * run.step, 'us', digits=2)}" if run.cost else ""
    return f"{run.error:.2g}{time}"
