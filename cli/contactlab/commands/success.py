"""`contactlab success`: how many successes of a policy are physical."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Arguments, Option, command
from contactlab.command_line.judgements import list_printers
from contactlab.command_line.quantities import read_share
from contactlab.command_line.report_formats import report_formats
from contactlab.command_line.surroundings import rerun_with_mujoco, say, study_session

if TYPE_CHECKING:
    from contactlab.schema.success import SuccessReport
    from contactlab.store.finished_store import Store
    from contactlab.store.store_files import Address
    from contactlab.writers import Report


def _list_findings(report: "SuccessReport", arguments: Arguments) -> "Report":
    from contactlab.studies.success.success_findings import report_of

    del arguments
    return report_of(report)


@command(
    "examine",
    keeps="finished runs",
    examples=(
        "success lift.py:make --drive pick.py:Policy --allow-code",
        'success push.yaml --require "physical >= 80 %" --format junit --allow-code',
        "success results/recorded",
    ),
    codes="0 as required, 1 a requirement is not met, 2 bad input, 130 interrupted",
    formats={**report_formats(), **list_printers(_list_findings, "junit", "github")},
)
def success(
    source: Annotated[
        "Store | Address | str",
        Argument("ENV|SWEEP|STORE", "FILE.py:FACTORY, id of Gymnasium, sweep or store.", kind=str),
    ],
    *,
    drive: opt.Drive = None,
    episodes: Annotated[
        int | None, Option("N", "Episodes as written, at most; default 100.", least=1)
    ] = None,
    object: Annotated[
        Sequence[str],
        Option("BODY", "Body of the object; found automatically; may be repeated.", kind=list[str]),
    ] = (),
    variant: Annotated[
        Sequence[str],
        Option("NAME", "Play only this variant; may be repeated.", kind=list[str]),
    ] = (),
    depth: Annotated[
        float | str,
        Option("SHARE", "Largest lasting depth, over the thinner body's thickness.", kind=str),
    ] = "25%",
    require: Annotated[
        Sequence[str],
        Option(
            "SHARE",
            "'physical >= 80 %' or 'success >= 90 %'; ends once decided; may be repeated.",
            kind=list[str],
        ),
    ] = (),
    precision: Annotated[
        float | str | None,
        Option("SHARE", "End once intervals reach this half width: 5%.", kind=str),
    ] = None,
    duration: opt.Duration = None,
    output: opt.StudyFolder = None,
    mujoco: opt.Mujoco = None,
    workers: opt.Workers = None,
    plugin: opt.Plugins = (),
    allow_code: opt.AllowCode = False,
) -> "SuccessReport":
    """Tell how many successes of a policy are physical.

    Plays the same episodes as written and under variants: of numerics, which must not matter, and
    of what a robot meets. A physical success has sound contacts of its object and survives all
    variants of numerics. Recorded episodes are judged by their contacts alone. The report, its page
    and the store of all episodes go to `results/success/NAME` unless `output` is given.

    Raises:
        SceneError: there is no environment, or its code is not allowed or fails.
        SweepFileError: an option or the sweep is wrong.
        StoreError: the episodes do not say how they ended.
        StoppedError: it was interrupted; the same call resumes it.
    """
    from contactlab.store.finished_store import Store
    from contactlab.studies.success.success_request import SuccessRequest

    opt.load_plugins(plugin)
    name = str(source.address) if isinstance(source, Store) else str(source)
    folder = opt.study_folder("success", name.replace(".py:", "-"), output)
    rerun_with_mujoco(mujoco, folder)
    task = opt.task_of(drive=drive, duration=duration)
    request = SuccessRequest(
        name,
        episodes,
        task.drive,
        [object] if isinstance(object, str) else object,
        [variant] if isinstance(variant, str) else variant,
        read_share(depth, "--depth"),
        [require] if isinstance(require, str) else require,
        None if precision is None else read_share(precision, "--precision"),
        task.duration,
    )
    from contactlab.page.success_page import success_page
    from contactlab.schema.success import PAGE, REPORT
    from contactlab.store.atomic_files import atomic_write, write_errors
    from contactlab.studies.success.success_study import judge_successes

    with study_session(folder, workers, allow_code=allow_code) as session:
        report = judge_successes(request, session)
        files = {
            REPORT: report.model_dump_json(indent=2) + "\n",
            PAGE: success_page(report, Store.open(report.store)),
        }
        with write_errors(folder):
            folder.mkdir(parents=True, exist_ok=True)
            for file, text in files.items():
                with atomic_write(folder / file) as path:
                    path.write_text(text, encoding="utf-8")
        say(f"wrote {folder / REPORT} and {PAGE}")
    return report
