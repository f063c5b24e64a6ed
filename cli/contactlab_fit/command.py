"""`contactlab fit`: the settings that explain recorded motion."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from contactlab.commands import options as opt
from contactlab.commands.terminal import echo, print_table, study_session
from contactlab.resources import RESULTS

if TYPE_CHECKING:
    from contactlab.schema.study_reports import FittedSetting


@opt.helped(
    "fit cube_toss",
    "fit scene/ --free friction.slide=0.1:1,solref --fitted 60",
    codes="0 fitted, 2 bad input, 130 interrupted",
)
def fit(
    scene: str = typer.Argument(..., help="A scene with a recording."),
    folder: Path | None = opt.STUDY_FOLDER,
    *,
    free: str = opt.option(
        "NAME,NAME=LOW:HIGH", "What to fit.", "friction.slide,solref,impratio,cone"
    ),
    assign: list[str] | None = opt.SET,
    fitted: int = opt.option("N", "Recorded runs to fit; the others are held out.", 120, min=2),
    seed: int = opt.option("N", "Which runs are fitted.", 0, min=0),
    error: str = opt.option("METRIC", "What is made small.", "reality"),
    workers: int | None = opt.WORKERS,
    plugin: list[Path] | None = opt.PLUGIN,
    output: opt.Format = opt.FORMAT,
) -> None:
    """Fit settings to recorded motion, with intervals, and try them on runs that were held out."""
    from contactlab.schema.study_reports import FITTED
    from contactlab.studies.session import model_name
    from contactlab_fit.fitting import FitRequest, run

    opt.load_plugins(plugin)
    request = FitRequest(scene, free.split(","), assign or (), fitted, seed, error)
    target = folder or RESULTS / "fit" / model_name(scene)
    with study_session(target, workers) as session:
        report = run(request, session)
    if output == "json":
        echo(report.model_dump_json(indent=2))
        return
    low, high = report.held_out_interval
    echo(
        f"{scene}: {error} {report.held_out_error:.3g} ({low:.3g} to {high:.3g}) on "
        f"{len(report.held_out)} runs held out, as written {report.written_error:.3g}; "
        f"{report.fitted_error:.3g} on {len(report.fitted_runs)} fitted"
    )
    if report.noise_floor is not None:
        echo(f"the start noise of the scene moves the error of a run by {report.noise_floor:.3g}")
    print_table(
        ("setting", "fitted", "95 %", "identified"), [_fitted_row(x) for x in report.settings]
    )
    worst = sorted(report.held_out.items(), key=lambda item: -item[1])[:5]
    echo(f"least explained: {', '.join(f'run {run} ({x:.3g})' for run, x in worst)}")
    echo(f"wrote {target / 'fitted' / FITTED}, after {report.runs:,} runs")


def _fitted_row(each: "FittedSetting") -> tuple[object, ...]:
    interval = f"{each.interval[0]:.3g} to {each.interval[1]:.3g}" if each.interval else ""
    value = f"{each.value:.4g}" if isinstance(each.value, float) else each.value
    return each.name, value, interval, "yes" if each.identified else "no: the error is flat"
