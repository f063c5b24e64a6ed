"""Add engines, and compare them with closed forms."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Given, Option, command
from contactlab.command_line.report_formats import report_formats
from contactlab.command_line.surroundings import say, study_session
from contactlab.command_line.terminal import echo

if TYPE_CHECKING:
    from contactlab.schema.engine_panel import EnginePanel


def _text(version: str, given: Given) -> None:
    echo(f"{given['name']} {version}")


@command("extend", name="engines add", examples=("engines add bullet",), formats={"text": _text})
def add(name: Annotated[str, Argument("NAME", "Engine to install.")]) -> str:
    """Install an engine in its own environment, in the user's cache.

    Returns its version.

    Raises:
        EngineError: there is no such engine, or this machine cannot run it.
    """
    from contactlab.engines import find_engine
    from contactlab.engines.adapted_engine import AdaptedEngine
    from contactlab.run.mujoco_environment import make_environment

    engine = find_engine(name)
    if not isinstance(engine, AdaptedEngine) or engine.version:
        return f"{engine.version} is already installed"
    say(f"setting up {name} in {engine.environment}, once")
    advice = f"check whether this machine can run {' and '.join(engine.requirements)}"
    make_environment(engine.environment, engine.requirements, name, advice, lambda _: None)
    return engine.version


def _panel_folder(output: str | Path | None) -> Path:
    from contactlab.resources import RESULTS

    return RESULTS / "engines" if output is None else opt.folder_of(output)


@command(
    "examine",
    name="engines panel",
    examples=("engines panel", "engines panel bounce slide --engine mujoco,drake"),
    codes="0 measured, 2 bad input, 130 interrupted",
    formats=report_formats(lambda given: _panel_folder(given["output"])),
)
def panel(
    tasks: Annotated[
        Sequence[str],
        Argument("TASK", "Task, such as bounce or stack; default: all.", kind=list[str]),
    ] = (),
    *,
    engine: Annotated[
        str | Sequence[str],
        Option("NAME,NAME", "Default: every installed engine with its own contact laws.", kind=str),
    ] = (),
    figure: opt.Figure = None,
    output: opt.StudyFolder = None,
) -> "EnginePanel":
    """Compare engines with closed forms, at three steps each, with the CPU time of stepping.

    Each task and engine has a store in `results/engines`, or in the folder `output`. The same
    command resumes it.

    Raises:
        SweepFileError: there is no such task.
        EngineError: there is no such engine, or it is not installed.
    """
    from contactlab.studies.engine_panel.engine_panel import PanelRequest, run_panel

    opt.check_figure(figure)
    named = engine.split(",") if isinstance(engine, str) else engine
    asked = PanelRequest([tasks] if isinstance(tasks, str) else list(tasks), list(named))
    with study_session(_panel_folder(output), 0) as session:
        report = run_panel(asked, session)
    if figure is not None:
        from contactlab.charts import save_figure
        from contactlab.studies.engine_panel.panel_chart import chart_panel

        save_figure(chart_panel(report), Path(figure))
        say(f"drew {figure}")
    return report
