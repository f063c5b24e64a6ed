"""`contactlab check`: whether a model can be trusted, and what to change where it cannot."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from contactlab.commands import options as opt
from contactlab.commands.stopping import study_session
from contactlab.commands.terminal import echo, echo_commands, print_table
from contactlab.errors import ExpectationError
from contactlab.resources import RESULTS

if TYPE_CHECKING:
    from contactlab.schema.check_report import CheckReport
    from contactlab.schema.judged_check import AcceptedCheck

CheckFormat = Literal["text", "json", "junit", "github"]
_MOST_NOTES = 4


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
    drive: opt.DriveOption = None,
    limit: Annotated[
        list[str] | None,
        typer.Option(metavar="METRIC=VALUE", help="Replace a limit: slip=1e-3; may be repeated."),
    ] = None,
    accept: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="File of findings that are accepted, with reasons."),
    ] = None,
    remedies: Annotated[
        bool, typer.Option(help="Look for changes that help, by running the model with them.")
    ] = True,
    workers: opt.WorkersOption = None,
    plugin: opt.PluginOption = None,
    allow_code: opt.AllowCodeOption = False,
    output: Annotated[CheckFormat, typer.Option("--format", help="How results are printed.")] = (
        "text"
    ),
) -> None:
    """Check a model; exit with 1 if there is an error that is not accepted."""
    from contactlab.plan.overrides import drive_option
    from contactlab.studies.check.model_check import CheckRequest, run
    from contactlab.studies.session import model_name

    opt.load_plugins(plugin)
    request = CheckRequest(
        model=model,
        assign=[*(assign or ()), *([f"keyframe={keyframe}"] if keyframe else [])],
        only=only or (),
        kind=None if kind == "auto" else kind,
        drive=drive_option(drive),
        limits=dict(opt.read_limit(text) for text in limit or ()),
        accepted=_accepted(accept),
        remedies=remedies,
    )
    target = folder or RESULTS / "check" / model_name(model)
    with study_session(target, workers, "start over", allow_code=allow_code) as session:
        report = run(request, session)
    _print(report, target, output)
    if failed := [each.name for each in report.findings if each.outcome == "failed"]:
        raise ExpectationError(f"{model} fails {', '.join(failed)}")


def _accepted(file: Path | None) -> "Sequence[AcceptedCheck]":
    if file is None:
        return ()
    from contactlab.plan.sweep_file import read_yaml_as
    from contactlab.schema.judged_check import Acceptances

    return read_yaml_as(file, Acceptances).accept


def _print(report: "CheckReport", folder: Path, output: CheckFormat) -> None:
    from contactlab.ci_output import JUnitCase, annotations, junit

    title = f"contactlab check {report.scene}"
    match output:
        case "text":
            _print_text(report, folder)
        case "json":
            echo(report.model_dump_json(indent=2))
        case "junit":
            cases = [
                JUnitCase(each, (report.scene, each.check), each.severity)
                for each in report.findings
            ]
            echo(junit(title, cases).rstrip("\n"))
        case "github":
            errors, warnings = (
                [each.full_message for each in report.findings if each.outcome == outcome]
                for outcome in ("failed", "warned")
            )
            echo_commands(annotations(title, errors, warnings).rstrip("\n"))


def _print_text(report: "CheckReport", folder: Path) -> None:
    from contactlab.studies.check import check_page

    echo(f"{report.scene}, {check_page.conditions(report)}")
    print_table(("", "finding", "result"), list(check_page.summary_rows(report)))
    for each in report.checks:
        for note in each.notes[:_MOST_NOTES]:
            echo(f"{each.name}: {note}")
        if len(each.notes) > _MOST_NOTES:
            echo(f"{each.name}: and {len(each.notes) - _MOST_NOTES} more notes in check.md")
    for note in report.notes:
        echo(note)
    if report.remedies:
        echo(check_page.REMEDIES)
    for number, remedy in enumerate(report.remedies, 1):
        echo("\n".join(check_page.remedy_lines(number, remedy)))
    echo(check_page.STABILITY.format(model=report.model))
    verdict = "passes" if report.passed else "fails"
    echo(f"{report.model} {verdict}; all numbers and evidence are in {folder / 'check.md'}")
