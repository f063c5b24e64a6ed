"""`contactlab gradients`: where derivatives through contact can be trusted."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Arguments, Option, command
from contactlab.command_line.report_formats import report_formats
from contactlab.command_line.surroundings import say, study_session

if TYPE_CHECKING:
    from contactlab.schema.gradients import GradientsReport


def _find_folder(arguments: Arguments) -> Path:
    return opt.study_folder("gradients", arguments["source"], arguments["output"])


@command(
    "examine",
    keeps="finished runs",
    examples=(
        "gradients robot.xml --output-coordinate torso.z --input thigh.v --drive none",
        "gradients map.yaml --output-coordinate x.v --input speed --figure map.svg",
    ),
    codes="0 measured, 2 bad input, 130 interrupted",
    formats=report_formats(_find_folder),
)
def gradients(
    source: Annotated[
        str | Path,
        Argument(
            "SCENE|SWEEP|MODEL", "One or two sweep axes with several values span a map.", kind=str
        ),
    ],
    *,
    output_coordinate: Annotated[
        str, Option("COORDINATE", "Coordinate whose end value is differentiated: ball.z.")
    ],
    input: Annotated[
        str | Sequence[str],
        Option(
            "NAME,NAME",
            "Axes, or coordinates of the start; default: the axes of the map.",
            kind=str,
        ),
    ] = (),
    set: opt.Set = (),
    include: Annotated[
        str | Sequence[str] | None,
        Option(
            "METHOD,METHOD",
            "Other methods: chain (default at one place), mjx or mjx-adaptive.",
            kind=str,
        ),
    ] = None,
    tolerance: Annotated[
        float, Option("SHARE", "Largest missing share of the derivative.", least=0.0)
    ] = 0.1,
    refinement: Annotated[
        int | None,
        Option("N", "Refinement factor of the reference; default 4, or 2 on a map.", least=2),
    ] = None,
    keyframe: opt.Keyframe = None,
    drive: opt.Drive = None,
    duration: opt.Duration = None,
    figure: opt.Figure = None,
    output: opt.StudyFolder = None,
    workers: opt.Workers = None,
    plugin: opt.Plugins = (),
) -> "GradientsReport":
    """Find where a derivative through contact can be trusted.

    The derivative of the run, at its own timestep, is compared with the derivative of the model,
    measured at finer timesteps. Results go to `results/gradients/NAME` unless `output` is given.

    Raises:
        SceneError: there is no such scene.
        SweepFileError: the sweep, a setting or a name is wrong.
        EngineError: an engine is not installed, or cannot differentiate.
    """
    from contactlab.studies.gradients.differentiating import GradientsRequest, differentiate_scene

    opt.load_plugins(plugin)
    opt.check_figure(figure)
    request = GradientsRequest(
        str(source),
        output_coordinate,
        _split_names(input) or (),
        opt.write_assignments(set),
        _split_names(include),
        tolerance,
        refinement,
        opt.task_of(keyframe, drive, duration),
    )
    with study_session(opt.study_folder("gradients", source, output), workers) as session:
        report = differentiate_scene(request, session)
    if figure is not None:
        from contactlab.charts import save_figure
        from contactlab.studies.gradients.gradients_chart import chart_gradients

        save_figure(chart_gradients(report), Path(figure))
        say(f"drew {figure}")
    return report


def _split_names(names: str | Sequence[str] | None) -> Sequence[str] | None:
    return [name for name in names.split(",") if name] if isinstance(names, str) else names
