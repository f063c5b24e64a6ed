"""`contactlab diff`: the differences of two models."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from contactlab.command_line.declaration import Argument, Option, command
from contactlab.command_line.report_formats import report_formats
from contactlab.errors import SweepFileError

if TYPE_CHECKING:
    from contactlab.schema.diff_report import DiffReport

_WHAT = "Scene, .xml or .urdf file, menagerie:ROBOT, or a store, for its scene."


@command(
    "gate",
    keeps="nothing",
    examples=("diff robot.xml converted.xml", "diff robot.urdf robot.xml --tolerance 1%"),
    formats=report_formats(),
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
    from contactlab.schema.setting_values import parse_decimal
    from contactlab.studies.diff.compare_models import diff_models

    text = str(tolerance)
    try:
        share = parse_decimal(text.removesuffix("%")) / (100 if text.endswith("%") else 1)
    except ValueError:
        share = -1.0
    if not 0 <= share < float("inf"):
        raise SweepFileError(f"--tolerance {text}: not a share; write for example 1%")
    return diff_models(str(before), str(after), share)
