"""`contactlab stability`: the catalogue of hard cases, and the failure labels of a model."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Unpack

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, command
from contactlab.command_line.report_formats import report_formats
from contactlab.command_line.surroundings import rerun_with_mujoco, study_session
from contactlab.commands.examine import examined
from contactlab.errors import SweepFileError

if TYPE_CHECKING:
    from contactlab.schema.check_report import StabilityReport
    from contactlab.schema.examination import Examination


@command(
    "examine",
    examples=("stability", "stability robot.xml --duration 5"),
    formats=report_formats(),
)
def stability(
    names: Annotated[
        Sequence[str | Path],
        Argument("NAME", "Cases, or a model; all cases by default.", kind=list[str]),
    ] = (),
    *,
    output: opt.StudyFolder = None,
    workers: opt.Workers = None,
    mujoco: opt.Mujoco = None,
    set: opt.Set = (),
    plugin: opt.Plugins = (),
    allow_code: opt.AllowCode = False,
    **task: Unpack[opt.TaskParameters],
) -> "StabilityReport | Examination":
    """Run hard cases, or a model; list those that fail.

    Each case has a store in `results/stability`, or in the folder `output`. For a model it is the
    section `labels` of its examination, with the same numbers.

    Raises:
        SweepFileError: there is no such case, or a setting is wrong.
    """
    from contactlab.resources import RESULTS
    from contactlab.studies.examine.examination import ExamineRequest
    from contactlab.studies.stability_cases import find_cases, is_model, run

    folder = RESULTS / "stability" if output is None else opt.folder_of(output)
    rerun_with_mujoco(mujoco, None if output else folder)
    opt.load_plugins(plugin)
    asked = opt.task_of(**task)
    named = [str(name) for name in ([names] if isinstance(names, str | Path) else names)]
    if any(map(is_model, named)):
        if len(named) > 1:
            raise SweepFileError(f"{' '.join(named)}: write one model, or cases")
        request = ExamineRequest(
            model=named[0], assign=opt.assigned(set), task=asked, sections=("labels",)
        )
        return examined(request, output, workers, allow_code=allow_code)
    cases = find_cases(named)
    given = [*opt.assigned(set), *asked.settings, *asked.observe, *asked.limits]
    if given or asked.drive or asked.tolerance or asked.seeds:
        raise SweepFileError(
            f"the case '{cases[0].name}' already defines its settings and drive; use a model "
            "instead, or edit the sweep of the case"
        )
    then = "repeat the finished cases and resume this one"
    with study_session(folder, workers, then, allow_code=allow_code) as session:
        return run(cases, session)
