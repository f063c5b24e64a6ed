"""`contactlab gradients`: where derivatives through contact can be trusted."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Given, Option, command
from contactlab.command_line.surroundings import say, study_session
from contactlab.command_line.terminal import echo, print_report_json, print_table

if TYPE_CHECKING:
    from contactlab.schema.gradients import GradientsReport


def _text(report: "GradientsReport", given: Given) -> None:
    from contactlab.studies.gradients.differentiating import REPORT
    from contactlab.studies.gradients.gradient_lines import advice, head, map_rows, place_rows

    echo(head(report))
    if not report.axes:
        echo(report.places[0].mode)
    print_table(*(map_rows(report) if report.axes else place_rows(report)))
    for line in (*advice(report), *report.notes):
        echo(line)
    folder = opt.study_folder("gradients", given["source"], given["output"])
    echo(f"evidence and {REPORT} in {folder}")


@command(
    "examine",
    examples=(
        "gradients robot.xml --of torso.z --by thigh.v,friction.slide --drive none",
        "gradients map.yaml --of x.v --by speed --figure map.svg",
    ),
    codes="0 measured, 2 bad input, 130 interrupted",
    formats={"text": _text, "json": print_report_json},
)
def gradients(
    source: Annotated[
        str | Path,
        Argument("SCENE|SWEEP|MODEL", "Two axes of a sweep with several values map.", kind=str),
    ],
    *,
    of: Annotated[str, Option("COORDINATE", "What is differentiated, at the end: ball.z.")],
    by: Annotated[
        str | Sequence[str],
        Option("NAME,NAME", "Axes, or coordinates of the start; a map's by default.", kind=str),
    ] = (),
    set: opt.Set = (),
    also: Annotated[
        str | Sequence[str] | None,
        Option(
            "MEANS,MEANS",
            "chain, of transition matrices, the default at one place; mjx; mjx-adaptive.",
            kind=str,
        ),
    ] = None,
    within: Annotated[
        float, Option("SHARE", "Of the model's derivative that may be missing.", least=0.0)
    ] = 0.1,
    finer: Annotated[
        int | None,
        Option("N", "By how much finer steps the model is told; 4, on a map 2.", least=2),
    ] = None,
    keyframe: opt.Keyframe = None,
    drive: opt.Drive = None,
    duration: opt.Duration = None,
    figure: opt.Figure = None,
    output: opt.StudyFolder = None,
    workers: opt.Workers = None,
    plugin: opt.Plugins = (),
) -> "GradientsReport":
    """Say where a derivative through contact can be trusted.

    The derivative of the run, at its own step, is held against that of the model, of which the run
    is one stepping. Everything goes to `results/gradients/NAME` if `output` is left out.

    Raises:
        SceneError: there is no such scene.
        SweepFileError: the sweep, a setting or a name is wrong.
        EngineError: an engine that differentiates is not installed, or cannot do it.
    """
    from contactlab.studies.gradients.differentiating import GradientsRequest, run

    opt.load_plugins(plugin)
    opt.check_figure(figure)
    request = GradientsRequest(
        str(source),
        of,
        _listed(by) or (),
        opt.assigned(set),
        _listed(also),
        within,
        finer,
        opt.task_of(keyframe, drive, duration),
    )
    with study_session(opt.study_folder("gradients", source, output), workers) as session:
        report = run(request, session)
    if figure is not None:
        from contactlab.charts import save_figure
        from contactlab.studies.gradients.gradients_chart import specification

        save_figure(specification(report), Path(figure))
        say(f"drew {figure}")
    return report


def _listed(names: str | Sequence[str] | None) -> Sequence[str] | None:
    return [name for name in names.split(",") if name] if isinstance(names, str) else names
