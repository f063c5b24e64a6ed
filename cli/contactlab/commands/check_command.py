"""`contactlab check`: whether a model can be trusted, and what to change where it cannot."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from contactlab.commands import options as opt
from contactlab.commands.stopping import study_session
from contactlab.commands.terminal import echo, print_table
from contactlab.errors import ExpectationError
from contactlab.resources import RESULTS

if TYPE_CHECKING:
    from contactlab.schema.check_report import Change, CheckReport


def check(
    model: Annotated[
        str, typer.Argument(help="Scene, scene folder, .xml or .urdf file, or menagerie:ROBOT.")
    ],
    assign: opt.SetOption = None,
    only: Annotated[
        list[str] | None,
        typer.Option("--only", metavar="CHECK", help="Make only this check; may be repeated."),
    ] = None,
    folder: opt.StudyFolderOption = None,
    *,
    keyframe: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Keyframe to start from; qpos0 is the model's default pose."
        ),
    ] = None,
    kind: Annotated[
        Literal["auto", "manipulation", "locomotion"],
        typer.Option(help="Task that the timestep has to suit."),
    ] = "auto",
    workers: opt.WorkersOption = None,
    plugin: opt.PluginOption = None,
    allow_code: opt.AllowCodeOption = False,
    output: opt.FormatOption = "text",
) -> None:
    """Check a model: timestep, free motion, flat contact, hold, repeat, shells."""
    from contactlab.studies.check.model_check import CheckRequest, run
    from contactlab.studies.session import model_name

    opt.load_plugins(plugin)
    request = CheckRequest(
        model=model,
        assign=[*(assign or ()), *([f"keyframe={keyframe}"] if keyframe else [])],
        only=only or (),
        kind=None if kind == "auto" else kind,
    )
    target = folder or RESULTS / "check" / model_name(model)
    with study_session(target, workers, "start over", allow_code=allow_code) as session:
        report = run(request, session)
    if output == "json":
        echo(report.model_dump_json(indent=2))
    else:
        _print(report, target)
    if failed := [each.name for each in report.checks if each.verdict == "fail"]:
        raise ExpectationError(f"{model} fails {', '.join(failed)}")


def _print(report: "CheckReport", folder: Path) -> None:
    start = f"keyframe {report.keyframe}" if report.keyframe else "its default pose"
    echo(f"{report.scene}, from {start}, for {report.kind} ({report.kind_reason})")
    print_table(
        ("check", "verdict", "result"),
        [(each.name, each.verdict, each.reason) for each in report.checks],
    )
    for each in report.checks:
        for note in each.notes:
            echo(f"{each.name}: {note}")
        for change in each.changes:
            echo("\n".join(_change(each.name, change)))
    verdict = "passes" if report.passed else "fails"
    echo(f"{report.model} {verdict}; all numbers and evidence are in {folder / 'check.md'}")


def _change(check: str, change: "Change") -> Iterator[str]:
    headings = {True: "this fixes it", False: "this does not fix it", None: "change"}
    yield f"{check}, {headings[change.cures]}: {change.shown}"
    yield from (f"    {line}" for line in change.lines)
