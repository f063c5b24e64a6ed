"""`contactlab tune`: from a model to the settings to use, written and verified."""

import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Unpack

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Arguments, Option, command, flag
from contactlab.command_line.quantities import read_error, read_seconds
from contactlab.command_line.report_formats import print_text, report_formats
from contactlab.command_line.surroundings import say
from contactlab.command_line.terminal import echo_bytes
from contactlab.errors import SweepFileError

if TYPE_CHECKING:
    from contactlab.schema.tune_report import TuneReport


def _find_folder(arguments: Arguments) -> Path:
    return opt.study_folder("tune", arguments["model"], arguments["output"])


def _print_result(report: "TuneReport", arguments: Arguments) -> None:
    from contactlab.schema.tune_report import PATCH

    patch = _find_folder(arguments) / PATCH
    if not arguments["patch"]:
        print_text(_find_folder)(report, arguments)
    elif report.recommended and patch.is_file():
        echo_bytes(patch.read_bytes())


@command(
    "examine",
    keeps="nothing",
    examples=("tune robot.xml",),
    formats={**report_formats(_find_folder), "text": _print_result},
)
def tune(
    model: Annotated[
        str | Path,
        Argument("MODEL", "An .xml or .urdf file, a scene, or menagerie:ROBOT.", kind=str),
    ],
    *,
    output: opt.StudyFolder = None,
    error: Annotated[
        float | str | None,
        Option(
            "ERROR",
            "Target error, 2%; default: its error as written. With --error-at in m, 1e-5.",
            kind=str,
        ),
    ] = None,
    real_time: Annotated[
        float | None,
        Option("N", "Find the most accurate settings at N times real time, not the fastest."),
    ] = None,
    error_at: Annotated[
        Literal["end", "peak"] | None,
        Option(None, "Measure the error of observed bodies, sites or sensors: end or peak."),
    ] = None,
    max_cpu: opt.MaxCpu = "2min",
    pick: Annotated[
        int | None,
        Option("N", "Write and verify point N of the front."),
    ] = None,
    apply: Annotated[
        Sequence[str],
        Option(
            "NAME",
            "Also apply sensors, far-pairs[=5cm] or hulls[=1mm], which no proof allows; may be "
            "repeated.",
            kind=list[str],
        ),
    ] = (),
    patch: Annotated[bool, flag("Print only the patch.")] = False,
    figure: Annotated[
        str | Path | None, Option("FILE", "Draw the front: a .png, .svg or .html file.", kind=Path)
    ] = None,
    dark: Annotated[bool, flag("Draw a .png or .svg on a dark background.")] = False,
    workers: opt.Workers = None,
    plugin: opt.Plugins = (),
    allow_code: opt.AllowCode = False,
    **task: Unpack[opt.TaskParameters],
) -> "TuneReport":
    """Find faster settings of equal accuracy, and write the model.

    The target is the fastest settings that are no less accurate than the model as written; if that
    is above the tolerance, the fastest settings within it. `error` allows another error. Results go
    to `results/tune/NAME` unless `output` is given.

    Raises:
        SceneError: there is no such model.
        SweepFileError: options contradict each other, or one is not a share, number or time.
        EngineError: nothing in the model moves.
        ExpectationError: a forward error is requested for a chaotic motion.
    """
    from contactlab.studies.search.tune_request import TuneRequest

    del patch
    names = task.get("observe", ())
    observed = (names,) if isinstance(names, str) else tuple(names)
    if error_at:  # then they are outputs of the forward error, such as a site, not task bodies
        task["observe"] = ()
    if real_time is not None and not 0 < real_time < math.inf:
        raise SweepFileError(f"--real-time {real_time:g}: write a number above 0, such as 5")
    request = TuneRequest(
        model=str(model),
        task=opt.task_of(**task),
        error=read_error(error, is_share=error_at is None),
        real_time=real_time,
        observed=observed if error_at else (),
        error_at=error_at,
        max_cpu=read_seconds(max_cpu, "--max-cpu"),
        pick=pick,
        apply=opt.read_reductions((apply,) if isinstance(apply, str) else apply),
    )
    opt.load_plugins(plugin)
    folder = opt.study_folder("tune", model, output)
    spent = time.process_time()  # imports count as part of the time limit
    from contactlab.run.worker_pool import worker_count
    from contactlab.studies.search.result_cache import find_cached_report
    from contactlab.studies.search.tuning import tune_model
    from contactlab.tasks.session import Session

    opt.check_figure(figure, ".html")
    session = Session(folder, worker_count(workers), notify=say, allow_code=allow_code)
    reuses_report = pick is not None or figure is not None
    cached_report = find_cached_report(request, session) if reuses_report else None
    if cached_report is not None:
        say("found the front of the same question in the folder; not searching again")
    report = tune_model(request, session, time.process_time() - spent, cached_report)
    if figure is not None:
        _draw_front(report, Path(figure), dark=dark)
        say(f"drew {figure}")
    return report


def _draw_front(report: "TuneReport", path: Path, *, dark: bool) -> None:
    from contactlab.charts import save_figure
    from contactlab.studies.search.search_chart import PAGE_LAYOUTS, draw_front, entitle_front

    if path.suffix != ".html":
        save_figure(draw_front(report), path, dark=dark or None)
        return
    from contactlab.page.front_page import build_front_page
    from contactlab.store.atomic_files import atomic_write
    from contactlab.studies.search.tune_document import describe_tuning

    figures = {name: draw_front(report, layout).to_dict() for name, layout in PAGE_LAYOUTS.items()}
    page = build_front_page(entitle_front(report), describe_tuning(report), figures)
    with atomic_write(path) as temporary:
        temporary.write_text(page, encoding="utf-8")
