"""`contactlab diff`: what two models do not have alike."""

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
    from contactlab.studies.diff.comparing import report_of

    del given
    return report_of(report)


def _failure(report: "DiffReport", given: Given) -> ExpectationError | None:
    del given
    return ExpectationError(report.headline) if report.differences else None


@command(
    "gate",
    examples=("diff robot.xml converted.xml", "diff robot.urdf robot.xml --within 1%"),
    formats={
        form: partial(print_report, form, _report_of) for form in ("text", "json", "markdown")
    },
    failure=_failure,
)
def diff(
    before: Annotated[str | Path, Argument("A", _WHAT, kind=str)],
    after: Annotated[str | Path, Argument("B", _WHAT, kind=str)],
    *,
    within: Annotated[
        float | str, Option("SHARE", "Share up to which quantities are alike.", kind=str)
    ] = "0.01%",
) -> "DiffReport":
    """Say what two models do not have alike; exit with 1 if anything.

    Parts are matched by name, and what is left by structure. Mass, joints, actuators, collision,
    filters, contact and options are compared, not looks. The last line is the change in motion.

    Raises:
        SceneError: there is no such model, or it does not compile.
        SweepFileError: the share is none.
    """
    from contactlab.studies.diff.comparing import diff as compared

    return compared(str(before), str(after), _share(within))


def _share(within: float | str) -> float:
    """Return a share as a number: of `1%`, 0.01."""
    text = str(within)
    try:
        share = float(text.removesuffix("%")) / (100 if text.endswith("%") else 1)
    except ValueError:
        share = -1.0
    if not 0 <= share < float("inf"):
        raise SweepFileError(f"--within {text}: write a share, such as 1%")
    return share
