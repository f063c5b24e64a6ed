"""`contactlab fit`: the settings that explain recorded motion."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Given, Option, command
from contactlab.command_line.surroundings import study_session
from contactlab.command_line.terminal import echo, print_report_json, print_table

if TYPE_CHECKING:
    from contactlab.schema.study_reports import FitReport, FittedSetting


def _text(report: "FitReport", given: Given) -> None:
    from contactlab.schema.study_reports import FITTED

    low, high = report.held_out_interval
    echo(
        f"{given['scene']}: {report.metric} {report.held_out_error:.3g} ({low:.3g} to {high:.3g}) "
        f"on {len(report.held_out)} held-out runs, {report.current_error:.3g} as written; "
        f"{report.fitted_error:.3g} on {len(report.fitted_runs)} fitted runs"
    )
    if report.noise_floor is not None:
        echo(f"noise floor: {report.noise_floor:.3g}, by the start noise of the scene")
    print_table(
        ("setting", "fitted", "95 %", "identified"), [_fitted_row(x) for x in report.settings]
    )
    worst = sorted(report.held_out.items(), key=lambda item: -item[1])[:5]
    echo(f"largest errors: {', '.join(f'run {run} ({x:.3g})' for run, x in worst)}")
    folder = opt.study_folder("fit", given["scene"], given["output"])
    echo(f"wrote {folder / 'fitted' / FITTED}, after {report.runs:,} runs")


@command(
    "examine",
    examples=("fit cube_toss", "fit scene/ --free friction.slide=0.1:1,solref --fitted 60"),
    codes="0 fitted, 2 bad input, 130 interrupted",
    formats={"text": _text, "json": print_report_json},
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
    request = FitRequest(str(scene), names, opt.assigned(set), fitted, seed, metric)
    with study_session(opt.study_folder("fit", scene, output), workers) as session:
        return fit_settings(request, session)


def _fitted_row(each: "FittedSetting") -> tuple[object, ...]:
    interval = f"{each.interval[0]:.3g} to {each.interval[1]:.3g}" if each.interval else ""
    value = f"{each.value:.4g}" if isinstance(each.value, float) else each.value
    return (
        each.name,
        value,
        interval,
        "yes" if each.identified else "no: the error does not depend on it",
    )
