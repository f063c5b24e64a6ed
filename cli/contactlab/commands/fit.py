"""`contactlab fit`: the settings that explain recorded motion."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Arguments, Option, command
from contactlab.command_line.report_formats import report_formats
from contactlab.command_line.surroundings import study_session

if TYPE_CHECKING:
    from contactlab.schema.study_reports import FitReport


def _find_folder(arguments: Arguments) -> Path:
    return opt.study_folder("fit", arguments["scene"], arguments["output"])


@command(
    "examine",
    keeps="finished runs",
    examples=("fit cube_toss", "fit scene/ --free friction.slide=0.1:1,solref --fitted 60"),
    codes="0 fitted, 2 bad input, 130 interrupted",
    formats=report_formats(_find_folder),
)
def fit(
    scene: Annotated[str | Path, Argument("SCENE", "A scene with a recording.", kind=str)],
    *,
    output: opt.StudyFolder = None,
    free: Annotated[
        str | Sequence[str],
        Option("NAME,NAME=LOW:HIGH", "Settings to fit, with optional bounds.", kind=str),
    ] = "friction.slide,solref,impratio,cone",
    set: opt.Set = (),
    fitted: Annotated[
        int, Option("N", "Recorded runs to fit; the others are held out.", least=2)
    ] = 120,
    seed: Annotated[int, Option("N", "Seed that selects the fitted runs.", least=0)] = 0,
    metric: Annotated[str, Option("NAME", "Metric to minimize.")] = "reality",
    workers: opt.Workers = None,
    plugin: opt.Plugins = (),
) -> "FitReport":
    """Fit settings to recorded motion, and test them on held-out runs.

    Results go to `results/fit/NAME` unless `output` is given.

    Raises:
        SceneError: the scene has no recording, or too few runs.
        SweepFileError: a setting or its bounds are wrong.
        ExpectationError: no run can be measured.
    """
    from contactlab.studies.fit.fitting import FitRequest, fit_settings

    opt.load_plugins(plugin)
    names = free.split(",") if isinstance(free, str) else free
    request = FitRequest(str(scene), names, opt.write_assignments(set), fitted, seed, metric)
    with study_session(opt.study_folder("fit", scene, output), workers) as session:
        return fit_settings(request, session)
