"""`contactlab diff`: the differences of two models."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from contactlab.command_line.declaration import Argument, Given, Option, command
from contactlab.command_line.judgements import print_report
from contactlab.errors import ExpectationError, SweepFileError

if TYPE_CHECKING:
    from contactlab.schema.diff_report import DiffReport
    from contactlab.writers import Report

_WHAT = "Scene, .xml or .urdf file, menagerie:ROBOT, or a store, for its scene."


def _report_of(report: "DiffReport", given: Given) -> "Report":
    from contactlab.studies.diff.compare_models import report_of

    del given
    return report_of(report)


def _failure(report: "DiffReport", given: Given) -> ExpectationError | None:
    del given
    return ExpectationError(report.headline) if report.differences else None


@command(
    "gate",
    examples=("diff robot.xml converted.xml", "diff robot.urdf robot.xml --tolerance 1%"),
    formats={
        form: partial(print_report, form, _report_of) for form in ("text", "json", "markdown")
    },
    failure=_failure,
)
def diff(
    before: Annotated[str | Path, Argument("A", _WHAT, kind=str)],
    after: Annotated[str | Path, Argument("B", _WHAT, kind=str)],
    *,
    tolerance: Annotated[
        float | str,
        Option("SHARE", "Relative change up to which quantities are equal.", kind=str),
    ] = "0.01%",
) -> "DiffReport":
    """Compare two models; exit with 1 if they differ.

    Parts are matched by name, then by structure. Mass, joints, actuators, collision, filters,
    contact and options are compared, but not looks. The last line is the change in motion.

    Raises:
        SceneError: there is no such model, or it does not compile.
        SweepFileError: the tolerance is not a share.
    """
    from contactlab.studies.diff.compare_models import diff as compared

    return compared(str(before), str(after), _read_share(tolerance))


def _read_share(tolerance: float | str) -> float:
    """Return a share as a number; `1%` is 0.01."""
    text = str(tolerance)
    try:
        share = float(text.removesuffix("%")) / (100 if text.endswith("%") else 1)
    except ValueError:
        share = -1.0
    if not 0 <= share < float("inf"):
        raise SweepFileError(f"--tolerance {text}: not a share; write for example 1%")
    return share
