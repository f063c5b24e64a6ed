"""`contactlab stability`: hard cases, and generic checks of models."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Given, command
from contactlab.command_line.surroundings import rerun_with_mujoco, study_session
from contactlab.command_line.terminal import echo, echo_unexercised, print_json, print_table
from contactlab.errors import ExpectationError
from contactlab.printable import shortened

if TYPE_CHECKING:
    from contactlab.schema.check_report import StabilityReport, StabilityResult


def _text(report: "StabilityReport", given: Given) -> None:
    from contactlab.studies.stability_cases import find_cases

    _print_cases(report.cases)
    named = [str(name) for name in given["names"]]
    for model in (case.origin for case in find_cases(named) if case.is_generic):
        echo(
            "stability looks at whole runs; what the model is made of, and what to change: "
            f"contactlab check {model}"
        )


def _json(report: "StabilityReport", given: Given) -> None:
    del given
    print_json(report.model_dump(mode="json"))


def _failure(report: "StabilityReport", given: Given) -> ExpectationError | None:
    del given
    failed = [case.name for case in report.cases if not case.passed]
    count = f"{len(failed)} of {len(report.cases)} cases failed"
    return ExpectationError(f"{count}: {', '.join(failed)}") if failed else None


@command(
    "examine",
    examples=("stability", "stability robot.xml --duration 5"),
    formats={"text": _text, "json": _json},
    failure=_failure,
)
def stability(
    names: Annotated[
        Sequence[str | Path],
        Argument("NAME", "Cases or model files; all cases by default.", kind=list[str]),
    ] = (),
    *,
    output: opt.StudyFolder = None,
    workers: opt.Workers = None,
    mujoco: opt.Mujoco = None,
    start: opt.Start = None,
    drive: opt.Drive = None,
    duration: opt.Duration = None,
    watch: opt.Watch = (),
    within: opt.Within = (),
    must: opt.Must = (),
    set: opt.Set = (),
    plugin: opt.Plugins = (),
    allow_code: opt.AllowCode = False,
) -> "StabilityReport":
    """Run hard cases, or a model; say which held and which failed.

    Each case has a store in `results/stability`, or in the folder `output`.

    Raises:
        SweepFileError: there is no such case, or a setting is wrong.
    """
    from contactlab.resources import RESULTS
    from contactlab.studies.stability_cases import StabilityRequest, run

    folder = RESULTS / "stability" if output is None else opt.folder_of(output)
    rerun_with_mujoco(mujoco, None if output else folder)
    opt.load_plugins(plugin)
    task = opt.task_of(start, drive, duration, watch, within, must)
    then = "repeat the finished cases and resume this one"
    request = StabilityRequest([str(name) for name in names], task, opt.assigned(set))
    with study_session(folder, workers, then, allow_code=allow_code) as session:
        return run(request, session)


def _print_cases(done: "Sequence[StabilityResult]") -> None:
    for line in dict.fromkeys(each.task.line for each in done if each.task):
        echo(line)
    for each in done:
        if each.verdict:
            echo(f"{each.name}: {each.verdict.line}")
    rows: list[tuple[object, ...]] = []
    for each in done:
        labels = ", ".join(f"{label} {count}" for label, count in each.labels.items())
        met = f"{each.met}/{each.asked}"
        end = (each.error, each.step, each.seconds)
        rows.append((each.name, each.runs, met, each.controls, labels, *end))
    header = ("case", "runs", "as expected", "controls", "labels", "error", "step", "seconds")
    print_table(header, rows)
    for each in done:
        for miss in shortened(each.misses, 5, each.store):
            echo(f"{each.name} {miss}")
    for each in done:
        echo_unexercised(each.not_exercised, f"{each.name}: ")
    seconds = sum(each.seconds for each in done)
    met = sum(each.passed for each in done)
    echo(f"{met} of {len(done)} cases are as expected, in {seconds:.0f} s")
