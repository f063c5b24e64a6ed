"""`contactlab check`: the checks of a model's examination, for CI."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Unpack

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Option, command
from contactlab.commands.examine import EXAMINATION_FORMATS, examined

if TYPE_CHECKING:
    from contactlab.schema.examination import Examination
    from contactlab.schema.finding import Waiver


@command(
    "examine",
    examples=("check robot.xml", "check menagerie:franka_emika_panda --format junit"),
    formats=EXAMINATION_FORMATS,
)
def check(
    model: opt.Model,
    *,
    set: opt.Set = (),
    check: Annotated[
        Sequence[str],
        Option("NAME", "Run only this check; may be repeated.", kind=list[str]),
    ] = (),
    output: opt.ExaminationOutput = None,
    waive: Annotated[
        "str | Path | Sequence[Waiver] | None",
        Option("FILE", "File of waivers: findings that may fail, with reasons.", kind=Path),
    ] = None,
    workers: opt.Workers = None,
    plugin: opt.Plugins = (),
    allow_code: opt.AllowCode = False,
    **task: Unpack[opt.TaskParameters],
) -> "Examination":
    """Check a model for CI; exit with 1 if a check fails.

    A waived check may fail. The report is the section `checks` of the model's examination, with the
    same numbers. Evidence goes to `results/examine/NAME` unless `output` names another folder.

    Raises:
        SceneError: there is no such model or keyframe, or it does not compile.
        SweepFileError: a setting, or the name of a check or a limit, is wrong.
        PolicyError: a waiver names no finding of any check.
    """
    from contactlab.studies.examine.examination import ExamineRequest

    opt.load_plugins(plugin)
    request = ExamineRequest(
        model=str(model),
        assign=opt.assigned(set),
        task=opt.task_of(**task),
        sections=("checks",),
        checks=check,
        accepted=_read_waivers(waive),
    )
    return examined(request, output, workers, allow_code=allow_code)


def _read_waivers(
    waive: "str | Path | Sequence[Waiver] | None",
) -> "Sequence[Waiver]":
    from contactlab.plan.sweep_file import read_yaml_as
    from contactlab.schema.finding import Waivers

    if isinstance(waive, str | Path):
        return read_yaml_as(Path(waive), Waivers).waive
    return waive or ()
