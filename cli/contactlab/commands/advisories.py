"""List known faults of engines, and check their witnesses."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from contactlab.command_line.declaration import Argument, Option, command
from contactlab.command_line.listing import LISTED, Listing
from contactlab.command_line.report_formats import report_formats
from contactlab.command_line.surroundings import say

if TYPE_CHECKING:
    from contactlab.schema.advisory_report import AdvisoriesCheck


@command("extend", examples=("advisories",), formats=LISTED)
def advisories() -> Listing:
    """List the advisories: known faults of engines, each with a model that shows it.

    Raises:
        AdvisoryError: a file of an installed package is wrong.
    """
    from contactlab.advisories.advisory_files import list_advisories

    rows = [
        (
            each.id,
            each.engine,
            ", ".join(map(str, each.affected)),
            each.severity,
            each.title,
        )
        for each in list_advisories()
    ]
    return Listing(("advisory", "engine", "releases", "severity", "title"), rows)


@command(
    "gate",
    name="advisories check",
    examples=(
        "advisories check --mujoco 3.17.0,4.0.0",
        "advisories check my-advisory.yaml",
    ),
    codes="0 each is as written, 1 not, 2 bad input",
    formats=report_formats(),
)
def check(
    files: Annotated[
        Sequence[str | Path],
        Argument("FILE", "Files of advisories; default: all listed ones.", kind=list[str]),
    ] = (),
    *,
    mujoco: Annotated[
        str | Sequence[str],
        Option("A,B,...", "Releases of MuJoCo; default: all that pip finds.", kind=str),
    ] = (),
) -> "AdvisoriesCheck":
    """Replay the witness of each advisory under releases of MuJoCo.

    It must show the fault in each affected release, and in no other.

    Raises:
        AdvisoryError: a file is wrong.
        EngineError: a release cannot be installed.
    """
    from contactlab.advisories.advisory_files import list_advisories, read_advisories
    from contactlab.studies.advisories.checking import check_advisories
    from contactlab.studies.lock.versions import list_supported_releases

    chosen = read_advisories(map(Path, files)) if files else list_advisories()
    named = mujoco.split(",") if isinstance(mujoco, str) else mujoco
    return check_advisories(chosen, named or list_supported_releases(), say)
