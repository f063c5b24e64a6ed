"""`contactlab stability`: the catalogue of hard cases."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, command
from contactlab.command_line.report_formats import report_formats
from contactlab.command_line.surroundings import rerun_with_mujoco, study_session

if TYPE_CHECKING:
    from contactlab.schema.check_report import StabilityReport


@command(
    "run",
    keeps="finished runs",
    examples=("stability", "stability tower_20 newtons_cradle"),
    formats=report_formats(),
)
def stability(
    names: Annotated[
        str | Sequence[str], Argument("CASE", "Cases; all by default.", kind=list[str])
    ] = (),
    *,
    output: opt.StudyFolder = None,
    workers: opt.Workers = None,
    mujoco: opt.Mujoco = None,
) -> "StabilityReport":
    """Run hard cases; list those that fail.

    Each case has a store in `results/stability`, or in the folder `output`.

    Raises:
        SweepFileError: there is no such case.
    """
    from contactlab.resources import RESULTS
    from contactlab.studies.stability_cases import find_cases, run_cases

    folder = RESULTS / "stability" if output is None else opt.folder_of(output)
    rerun_with_mujoco(mujoco, None if output else folder)
    opt.load_plugins(())
    cases = find_cases([names] if isinstance(names, str) else names)
    with study_session(folder, workers) as session:
        return run_cases(cases, session)
