"""List known faults of engines, and check their witnesses."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Option, command
from contactlab.command_line.listing import LISTED, Listing
from contactlab.command_line.report_formats import report_formats
from contactlab.command_line.surroundings import say, study_session

if TYPE_CHECKING:
    from contactlab.schema.advisory_report import AdvisoriesCheck
    from contactlab.schema.differences_report import DifferencesReport


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
    keeps="nothing",
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
        EngineError: a release cannot be installed, or replays no witness.
    """
    from contactlab.advisories.advisory_files import list_advisories, read_advisories
    from contactlab.studies.advisories.checking import check_advisories
    from contactlab.studies.lock.versions import list_supported_releases

    chosen = read_advisories(map(Path, files)) if files else list_advisories()
    chosen_releases = mujoco.split(",") if isinstance(mujoco, str) else mujoco
    return check_advisories(chosen, chosen_releases or list_supported_releases(), say)


@command(
    "gate",
    keeps="nothing",
    name="advisories find",
    examples=(
        "advisories find --mujoco 3.13.0,4.0.0",
        "advisories find robots/*.xml --mujoco 3.17.0,4.0.0 -o found",
    ),
    codes="0 compared, 1 no model was compared, 2 bad input, 130 interrupted",
    formats=report_formats(),
)
def find(
    models: Annotated[
        Sequence[str | Path],
        Argument(
            "MODEL", "Models, or the words scenes and generated; default: both.", kind=list[str]
        ),
    ] = (),
    *,
    mujoco: Annotated[
        str | Sequence[str], Option("OLDER,NEWER", "The two releases to compare.", kind=str)
    ],
    max_time: Annotated[
        float, Option("SECONDS", "Limit of wall time to shrink one difference.", least=0)
    ] = 10.0,
    output: opt.StudyFolder = None,
) -> "DifferencesReport":
    """Compare two releases of MuJoCo over models, and draft an advisory for each cause.

    Both begin in the same states. Differences are grouped by the first stage of a step that
    differs, and one model of each group is shrunk. A difference is a fault if an independent
    computation decides, and otherwise a change.

    Raises:
        SweepFileError: not two releases.
        EngineError: a release cannot be installed.
        OutputError: the drafts cannot be written.
    """
    from contactlab.errors import SweepFileError
    from contactlab.studies.advisories.corpus import GENERATED, SCENES
    from contactlab.studies.advisories.finding import FindRequest, find_differences

    releases = mujoco.split(",") if isinstance(mujoco, str) else list(mujoco)
    pair = 2
    if len(releases) != pair:
        raise SweepFileError("--mujoco: name two releases, such as 3.13.0,4.0.0")
    sources = [*map(str, models)] or [SCENES, GENERATED]
    folder = opt.study_folder("advisories", "-".join(releases), output)
    request = FindRequest(sources, (releases[0], releases[1]), max_time)
    with study_session(folder, 0) as session:
        return find_differences(request, session)
