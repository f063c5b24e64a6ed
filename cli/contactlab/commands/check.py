"""`contactlab check`: whether a model is fit to be trusted."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Given, Option, command, flag
from contactlab.command_line.judgements import printed
from contactlab.command_line.surroundings import study_session
from contactlab.errors import ContactlabError

if TYPE_CHECKING:
    from contactlab.schema.check_report import CheckReport
    from contactlab.schema.finding import Acceptance
    from contactlab.writers import Report


def _report_of(report: "CheckReport", given: Given) -> "Report":
    from contactlab.studies.check.check_results import report_of

    folder = opt.study_folder("check", given["model"], given["output"])
    return report_of(report, folder / "check.md")


def _failure(report: "CheckReport", given: Given) -> ContactlabError | None:
    from contactlab.judge.conclusion import error_of, exit_code, failed_names

    failed = ", ".join(failed_names(report.findings))
    return error_of(exit_code(report.findings), f"{given['model']} fails {failed}")


@command(
    "examine",
    examples=("check robot.xml", "check menagerie:franka_emika_panda --format junit"),
    formats=printed(_report_of),
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
        "str | Path | Sequence[Acceptance] | None",
        Option("FILE", "File of findings that are accepted, with reasons.", kind=Path),
    ] = None,
    remedies: Annotated[
        bool, flag("Look for changes that help, by running the model with them.")
    ] = True,
    workers: opt.Workers = None,
    plugin: opt.Plugins = (),
    allow_code: opt.AllowCode = False,
) -> "CheckReport":
    """Check a model for CI; exit with 1 if an error is not accepted.

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
    accept: "str | Path | Sequence[Acceptance] | None",
) -> "Sequence[Acceptance]":
    from contactlab.plan.sweep_file import read_yaml_as
    from contactlab.schema.finding import Acceptances

    if isinstance(accept, str | Path):
        return read_yaml_as(Path(accept), Acceptances).accept
    return accept or ()
