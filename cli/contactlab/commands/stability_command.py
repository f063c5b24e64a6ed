"""`contactlab stability`: the catalogue of hard cases, or generic checks of a model."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from contactlab.commands import options as opt
from contactlab.commands.stopping import study_session
from contactlab.commands.terminal import echo, print_json, print_table
from contactlab.errors import ExpectationError
from contactlab.resources import RESULTS

if TYPE_CHECKING:
    from contactlab.schema.check_report import StabilityResult

_MOST_MISSES = 5
_THEN = "repeat the finished cases and resume this one"


def stability(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="NAME", help="Cases or model files; all cases by default."),
    ] = None,
    folder: opt.StudyFolderOption = None,
    workers: opt.WorkersOption = None,
    mujoco: opt.MujocoOption = None,
    drive: opt.DriveOption = None,
    plugin: opt.PluginOption = None,
    allow_code: opt.AllowCodeOption = False,
    output: opt.FormatOption = "text",
) -> None:
    """Run hard cases; report what held, what failed, and whether that is as expected."""
    from contactlab.plan.overrides import drive_option
    from contactlab.studies.stability_cases import StabilityRequest, is_model, run

    target = folder or RESULTS / "stability"
    opt.rerun_with_mujoco(mujoco, None if folder else target)
    opt.load_plugins(plugin)
    with study_session(target, workers, _THEN, allow_code=allow_code) as session:
        report = run(StabilityRequest(names or (), drive_option(drive)), session)
    cases = report.cases
    if output == "json":
        print_json(report.model_dump(mode="json"))
    else:
        _print(cases)
        for model in filter(is_model, names or ()):
            echo(
                "stability looks at whole runs; what the model is made of, and what to change: "
                f"contactlab check {model}"
            )
    if failed := [each.name for each in cases if not each.passed]:
        raise ExpectationError(f"{len(failed)} of {len(cases)} cases failed: {', '.join(failed)}")


def _print(done: "Sequence[StabilityResult]") -> None:
    rows: list[tuple[object, ...]] = []
    for each in done:
        labels = ", ".join(f"{label} {count}" for label, count in each.labels.items())
        met = f"{each.met}/{each.asked}"
        end = (each.error, each.step, each.seconds)
        rows.append((each.name, each.runs, met, each.controls, labels, *end))
    header = ("case", "runs", "as expected", "controls", "labels", "error", "step", "seconds")
    print_table(header, rows)
    for each in done:
        if each.not_exercised:
            echo(f"{each.name} not exercised: {each.not_exercised}")
        for miss in each.misses[:_MOST_MISSES]:
            echo(f"{each.name} {miss}")
        if len(each.misses) > _MOST_MISSES:
            echo(f"{each.name} and {len(each.misses) - _MOST_MISSES} more in {each.store}")
    seconds = sum(each.seconds for each in done)
    met = sum(each.passed for each in done)
    echo(f"{met} of {len(done)} cases are as expected, in {seconds:.0f} s")
