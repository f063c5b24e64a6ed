"""`contactlab examine`: the error budget of a model under its task."""

from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Annotated

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Given, Option, command
from contactlab.command_line.surroundings import say
from contactlab.command_line.terminal import echo
from contactlab.errors import ExpectationError, OutputError

if TYPE_CHECKING:
    from contactlab.schema.examination import Examination


def _text(report: "Examination", given: Given) -> None:
    from contactlab.studies.examine.examination_lines import examination_lines

    del given
    echo("\n".join(examination_lines(report)))


def _full(report: "Examination", given: Given) -> None:
    from contactlab.studies.examine.examination_lines import examination_lines

    del given
    echo("\n".join(examination_lines(report, full=True)))


def _json(report: "Examination", given: Given) -> None:
    del given
    echo(report.model_dump_json(indent=2))


def _failure(report: "Examination", given: Given) -> ExpectationError | None:
    del given
    if report.sound:
        return None
    word, within = report.budget.verdict, report.budget.within
    return ExpectationError(f"{report.model} is not sound within {within:.0%}: {word}")


@command(
    "examine",
    examples=("examine robot.xml", "robot.xml --within 30% --write sound/robot.xml"),
    formats={"text": _text, "full": _full, "json": _json},
    failure=_failure,
)
def examine(
    model: Annotated[
        str | Path,
        Argument(
            "MODEL|SCENE", "Scene, scene folder, .xml or .urdf file, or menagerie:ROBOT.", kind=str
        ),
    ],
    *,
    set: opt.Set = (),
    output: Annotated[
        str | Path | None,
        Option("FILE", "File for the report: .json.", kind=Path, short="-o"),
    ] = None,
    write: Annotated[
        str | Path | None,
        Option("FILE", "File for the model with the first change that helps.", kind=Path),
    ] = None,
    start: opt.Start = None,
    drive: opt.Drive = None,
    duration: opt.Duration = None,
    watch: opt.Watch = (),
    within: opt.Within = (),
    workers: opt.Workers = None,
    plugin: opt.Plugins = (),
    allow_code: opt.AllowCode = False,
) -> "Examination":
    """Say whether a model can be trusted, and which change mends it.

    `contactlab MODEL` is short for it. A change is judged on the task's seeds and on fresh ones;
    `write` writes the model with the first that computes the same model otherwise.

    The verdict is sound, unresolved (the timestep, solver or integrator is at fault), not resolved
    (nor is the reference known), or model (the result hangs on how soft or regularised it is).

    Raises:
        SceneError: there is no such model, keyframe or body, or it does not compile.
        SweepFileError: a setting is wrong, or the tolerance is no share.
        EngineError: nothing moves, or MuJoCo is not what simulates.
        OutputError: the report or the model cannot be written.
    """
    from contactlab.store.atomic_files import atomic_write, write_errors
    from contactlab.studies.examine.examination import ExamineRequest, run

    opt.load_plugins(plugin)
    task = opt.task_of(start, drive, duration, watch, within)
    if output is not None:
        # Before minutes of measuring, a folder that cannot be written to.
        with write_errors(Path(output)), TemporaryFile(dir=Path(output).parent):
            if Path(output).is_dir():
                raise OutputError(f"{output} is a folder; write the name of a file, as in a.json")
    request = ExamineRequest(
        model=str(model),
        assign=opt.assigned(set),
        task=task,
        workers=workers,
        allow_code=allow_code,
        write=None if write is None else Path(write),
        told=say,
    )
    report = run(request)
    if output is not None:
        with write_errors(Path(output)), atomic_write(Path(output)) as path:
            path.write_text(report.model_dump_json(indent=2) + "\n", encoding="utf-8")
        say(f"wrote {output}")
    return report
