"""`contactlab check`: whether a model is fit to be trusted."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Given, Option, command, flag
from contactlab.command_line.surroundings import study_session
from contactlab.command_line.terminal import echo, echo_commands, echo_unexercised, print_table
from contactlab.errors import ExpectationError
from contactlab.printable import shortened

if TYPE_CHECKING:
    from contactlab.schema.check_report import CheckReport
    from contactlab.schema.comparison import AcceptedCheck


def _shown(form: str, report: "CheckReport", given: Given) -> None:
    from contactlab.ci_output import annotations, junit, junit_case

    title = f"contactlab check {report.scene}"
    match form:
        case "json":
            echo(report.model_dump_json(indent=2))
        case "junit":
            cases = [
                junit_case(finding, (report.scene, finding.check), finding.severity)
                for finding in report.findings
            ]
            echo(junit(title, cases).rstrip("\n"))
        case "github":
            errors, warnings = (
                [finding.full_message for finding in report.findings if finding.outcome == outcome]
                for outcome in ("failed", "warned")
            )
            echo_commands(annotations(title, errors, warnings).rstrip("\n"))
        case _:
            _print_findings(report, opt.study_folder("check", given["model"], given["output"]))


def _failure(report: "CheckReport", given: Given) -> ExpectationError | None:
    failed = [finding.name for finding in report.findings if finding.outcome == "failed"]
    return ExpectationError(f"{given['model']} fails {', '.join(failed)}") if failed else None


@command(
    "run",
    examples=("check robot.xml", "check menagerie:franka_emika_panda --format junit"),
    formats={form: partial(_shown, form) for form in ("text", "json", "junit", "github")},
    failure=_failure,
)
def check(
    model: Annotated[
        str | Path,
        Argument("MODEL", "Scene, scene folder, .xml or .urdf file, or menagerie:ROBOT.", kind=str),
    ],
    *,
    set: opt.Set = (),
    only: Annotated[
        Sequence[str],
        Option("CHECK", "Make only this check; may be repeated.", kind=list[str]),
    ] = (),
    output: opt.StudyFolder = None,
    kind: Annotated[
        Literal["auto", "manipulation", "locomotion"],
        Option(None, "Task that the timestep has to suit."),
    ] = "auto",
    start: opt.Start = None,
    drive: opt.Drive = None,
    duration: opt.Duration = None,
    watch: opt.Watch = (),
    within: opt.Within = (),
    must: opt.Must = (),
    accept: Annotated[
        "str | Path | Sequence[AcceptedCheck] | None",
        Option("FILE", "File of findings that are accepted, with reasons.", kind=Path),
    ] = None,
    remedies: Annotated[
        bool, flag("Look for changes that help, by running the model with them.")
    ] = True,
    workers: opt.Workers = None,
    plugin: opt.Plugins = (),
    allow_code: opt.AllowCode = False,
) -> "CheckReport":
    """Check a model; exit with 1 if there is an error that is not accepted.

    The report has each check with its numbers, and what helps. Evidence goes to
    `results/check/NAME` unless `output` names another folder.

    Raises:
        SceneError: there is no such model or keyframe, or it does not compile.
        SweepFileError: a setting, or the name of a check or a limit, is wrong.
        PolicyError: what is accepted is not a finding of any check.
    """
    from contactlab.studies.check.model_check import CheckRequest, run

    opt.load_plugins(plugin)
    request = CheckRequest(
        model=str(model),
        assign=opt.assigned(set),
        only=only,
        kind=None if kind == "auto" else kind,
        task=opt.task_of(start, drive, duration, watch, within, must),
        accepted=_accepted(accept),
        remedies=remedies,
    )
    folder = opt.study_folder("check", model, output)
    with study_session(folder, workers, "start over", allow_code=allow_code) as session:
        return run(request, session)


def _accepted(
    accept: "str | Path | Sequence[AcceptedCheck] | None",
) -> "Sequence[AcceptedCheck]":
    from contactlab.plan.sweep_file import read_yaml_as
    from contactlab.schema.comparison import Acceptances

    if isinstance(accept, str | Path):
        return read_yaml_as(Path(accept), Acceptances).accept
    return accept or ()


def _print_findings(report: "CheckReport", folder: Path) -> None:
    from contactlab.studies.check import check_results

    echo(report.task.line)
    if report.verdict is not None:
        echo(report.verdict.line)
    echo(f"{report.scene}, {check_results.conditions(report)}")
    print_table(("", "finding", "result"), list(check_results.summary_rows(report)))
    for each in report.checks:
        for note in shortened(each.notes, 4, "check.md"):
            echo(f"{each.name}: {note}")
    for note in report.notes:
        echo(note)
    if report.remedies:
        echo(check_results.REMEDIES)
    for number, remedy in enumerate(report.remedies, 1):
        echo("\n".join(check_results.remedy_lines(number, remedy)))
    echo(check_results.STABILITY.format(model=report.model))
    verdict = "passes" if report.passed else "fails"
    echo_unexercised(report.not_exercised)
    echo(f"{report.model} {verdict}; all numbers and evidence are in {folder / 'check.md'}")
