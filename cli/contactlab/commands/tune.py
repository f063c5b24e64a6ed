"""`contactlab tune`: from a model to the settings to use, written and verified."""

import math
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Unpack

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Given, Option, command, flag
from contactlab.command_line.surroundings import say
from contactlab.command_line.terminal import echo, echo_bytes, print_report_json, print_table
from contactlab.errors import ExpectationError, SweepFileError
from contactlab.judge.wording import out_of, plural
from contactlab.printable import percent, shell_word, shortened, wrapped

if TYPE_CHECKING:
    from contactlab.schema.tune_report import Judged, Point, StayedApart, TuneReport
    from contactlab.studies.search.tune_request import TuneRequest

_TIME = "a time, such as 90s, 5min or 1h"
_ERROR = "a share, such as 2%, or with --at a number in the unit of what is watched"


def _text(report: "TuneReport", given: Given) -> None:
    from contactlab.schema.tune_report import PATCH

    folder = opt.study_folder("tune", given["model"], given["output"])
    if given["patch"]:
        if report.recommended and (folder / PATCH).is_file():
            echo_bytes((folder / PATCH).read_bytes())
        return
    print_search(report, folder)


def failure(report: "TuneReport", given: Given) -> ExpectationError | None:
    """Return the error of an aim that nothing meets."""
    del given
    if report.met or report.recommended:
        return None
    return ExpectationError(f"{report.model}: {report.sentence}")


@command(
    "examine",
    examples=("tune robot.xml",),
    formats={"text": _text, "json": print_report_json},
    failure=failure,
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
            "Largest error, 2%; by default what the model is uncertain by. With --at in m, 1e-5.",
            kind=str,
        ),
    ] = None,
    real_time: Annotated[
        float | None,
        Option("N", "The most accurate settings at N times real time, instead of the fastest."),
    ] = None,
    at: Annotated[
        Literal["end", "peak"] | None,
        Option(None, "Error of what is watched, body, site or sensor: at the end, or at its peak."),
    ] = None,
    max_time: opt.MaxTime = "2min",
    drop_sensors: Annotated[
        bool, flag("Leave the model's sensors out: nobody reads them.")
    ] = False,
    apart: Annotated[
        float | str | None,
        Option(
            "LENGTH",
            "Leave out collisions of what stayed so far apart in all that was run, such as 5cm.",
            kind=str,
        ),
    ] = None,
    hulls: Annotated[
        float | str | None,
        Option(
            "LENGTH",
            "Try hulls of meshes of fewer vertices, which reach so far less at most, such as 1mm.",
            kind=str,
        ),
    ] = None,
    patch: Annotated[bool, flag("Print the patch, and no more.")] = False,
    figure: opt.Figure = None,
    workers: opt.Workers = None,
    plugin: opt.Plugins = (),
    allow_code: opt.AllowCode = False,
    **task: Unpack[opt.TaskParameters],
) -> "TuneReport":
    """Find the settings to use, and write the model that has them.

    The cheapest settings whose numerical error is at most what friction known to 10 % and masses
    known to 5 % leave open, at least 1 %, and at most the tolerance. Where a sound model misses
    that as written, the fastest of no larger error is recommended, beside what keeps the aim.
    Everything goes to `results/tune/NAME` if `output` is left out.

    Raises:
        SceneError: there is no such model.
        SweepFileError: options contradict each other, or one is no share, number or time.
        EngineError: nothing in the model moves.
        ExpectationError: a forward error is asked for of a chaotic motion.
    """
    from contactlab.studies.search.tune_request import TuneRequest

    del patch
    watch = task.get("observe", ())
    watched = (watch,) if isinstance(watch, str) else tuple(watch)
    if at:  # then it is what an error is of, such as a site, and no body of the task
        task["observe"] = ()
    request = TuneRequest(
        model=str(model),
        task=opt.task_of(**task),
        error=error_of(error),
        real_time=_positive_rate(real_time),
        watched=watched if at else (),
        at=at,
        max_time=seconds_of(max_time),
        drop_sensors=drop_sensors,
        apart=length_of(apart, "--apart", "5cm or 0.05"),
        hulls=length_of(hulls, "--hulls", "1mm or 0.001"),
    )
    opt.load_plugins(plugin)
    folder = opt.study_folder("tune", model, output)
    return searched(request, folder, workers, figure, allow_code=allow_code)


def searched(
    request: "TuneRequest",
    folder: Path,
    workers: int | None,
    figure: str | Path | None,
    *,
    allow_code: bool,
    known: Sequence[Path] = (),
) -> "TuneReport":
    """Search, unless a known folder has the answer, and draw it if a figure is asked for."""
    begin = time.monotonic()  # what is loaded now takes its part of the time allowed
    from contactlab.run.worker_pool import worker_count
    from contactlab.studies.search.answered import answered
    from contactlab.studies.search.tuning import run
    from contactlab.studies.session import Session

    opt.check_figure(figure)
    session = Session(folder, worker_count(workers), notify=say, allow_code=allow_code)
    report = answered(request, session, known) or run(request, session, begin)
    if figure is not None:
        from contactlab.charts import save_figure
        from contactlab.studies.search.search_chart import specification

        save_figure(specification(report), Path(figure))
        say(f"drew {figure}")
    return report


def error_of(error: float | str | None) -> float | None:
    """Return the largest error that is asked for, as a number; 2% is 0.02."""
    from contactlab.schema.setting_values import read_quantity

    if error is None:
        return None
    value, unit = read_quantity(str(error))
    if not 0 < value < math.inf or unit not in ("", "m", "rad", "1"):
        raise SweepFileError(f"--error {error}: write {_ERROR}")
    return value


def seconds_of(text: float | str, option: str = "--max-time") -> float:
    """Return a time that is allowed by an option [s]."""
    from contactlab.schema.setting_values import read_quantity

    value, unit = read_quantity(str(text))
    if not 0 < value < math.inf or unit not in ("", "s"):
        raise SweepFileError(f"{option} {text}: write {_TIME}")
    return value


def length_of(text: float | str | None, option: str, such_as: str) -> float | None:
    """Return a length of an option [m]."""
    from contactlab.schema.setting_values import read_quantity

    if text is None:
        return None
    value, unit = read_quantity(str(text))
    if not 0 < value < math.inf or unit not in ("", "m"):
        raise SweepFileError(f"{option} {text}: write a length, such as {such_as}")
    return value


def _positive_rate(rate: float | None) -> float | None:
    if rate is not None and not 0 < rate < math.inf:
        raise SweepFileError(f"--real-time {rate:g}: write a number above 0, such as 5")
    return rate


def print_search(report: "TuneReport", folder: Path) -> None:
    """Print the report of a search."""
    echo("\n".join(_head(report)))
    shown = [("now", report.now)]
    for standing, point in (
        ("recommended", report.recommended),
        ("keeps the aim", report.to_aim and report.to_aim.point),
        ("nearest", report.nearest),
        ("as accurate as now", report.as_accurate and report.as_accurate.point),
    ):
        if point:
            shown.append((standing, point))
    header = ("", "settings", "timestep [s]", "error", "over seeds", "in", "time")
    print_table(header, [_row(standing, point, report) for standing, point in shown])
    echo("\n".join(_details(report, folder)))


def _head(report: "TuneReport") -> Iterator[str]:
    aim = report.aim
    yield from wrapped(report.task.line)
    yield from wrapped(f"{report.model}: {report.sentence}")
    limit = _number(aim.limit, report)
    match aim.kind:
        case "uncertainty":
            source = f"what the model is uncertain by: {aim.uncertain_by}"
            if aim.uncertain is None or aim.uncertain < aim.limit:
                source = "the model is uncertain by less"
            elif aim.uncertain > aim.limit:
                source = "the tolerance"
            yield from wrapped(f"aim      error at most {limit} ({source})", "  ")
        case "real time":
            yield f"  aim      the least error at {aim.real_time:g} times real time"
        case _:
            yield f"  aim      error at most {limit}, as asked"
    if report.judged:
        yield from wrapped(f"judged   {_judged(report.judged, report)}", "  ")
    if aim.unit == "1":
        yield from wrapped(
            f"errors   beside the motion of the model as written at {report.fine_step:g} s, in "
            "windows that begin in its states",
            "  ",
        )
    if aim.growth:
        yield from wrapped(f"motion   {aim.growth}", "  ")
    yield from _searching(report)


def _searching(report: "TuneReport") -> Iterator[str]:
    from contactlab.studies.search.wording import unsaved

    ended = "; the time was over before all was tried" if report.ended else ""
    measured = f"{plural(len(report.points), 'choice')} measured in {report.seconds:.0f} s{ended}"
    yield from wrapped(f"search   {measured}", "  ")
    yield f"  speed    as written {report.real_time:.3g} times real time on one core"
    if why := unsaved(report):
        yield from wrapped(f"steps    {why}", "  ")


def _judged(judged: "Judged", report: "TuneReport") -> str:
    share = "MuJoCo gave up" if judged.share is None else f"{percent(judged.share)} as written"
    along = f"numerically {judged.word}, {share}, along its own motion"
    most = len(report.task.seeds)
    if len(judged.seeds) == most:
        return f"{along}: that of `contactlab MODEL`"
    few = out_of(len(judged.seeds), most, "seed")
    return f"{along}, on {few} alone: `contactlab MODEL` judges all {most}"


def _row(standing: str, point: "Point", report: "TuneReport") -> tuple[object, ...]:
    from contactlab.studies.search.choice import described
    from contactlab.studies.search.wording import price_text

    time = "" if point.price is None else price_text(point.price)
    spread = f"{_number(point.low, report)} to {_number(point.high, report)}"
    settings = described(point.settings) or ("as written" if standing == "now" else "")
    error = _number(point.error, report)
    return standing, settings, f"{point.timestep:g}", error, spread, point.body, time


def _number(value: float | None, report: "TuneReport") -> str:
    if value is None:
        return "gave up"
    return percent(value) if report.aim.unit == "1" else f"{value:.2e} {report.aim.unit}"


def _details(report: "TuneReport", folder: Path) -> Iterator[str]:
    from contactlab.schema.tune_report import PATCH

    if report.masked or report.excluded:
        yield from wrapped(
            f"exact: {_parted(report.masked, report.excluded)} cannot touch, by proof: the motion "
            "is the same without their collisions, bit for bit"
        )
    if report.flags:
        yield f"exact: no state depends on {' and '.join(report.flags)}; they are off now"
    for assumed in _assumed(report):
        yield from wrapped(assumed)
    if report.verified:
        fresh = report.verified.seeds
        seeds = f"seed{'s' * (len(fresh) > 1)} {', '.join(map(str, fresh))}"
        yield from wrapped(f"verified on {seeds}: {report.verified.sentence}")
    lines = [f"{each.file}:{each.line}: {each.element or 'removed'}" for each in report.lines]
    yield from shortened(lines, 12, PATCH)
    for note in _notes(report):
        yield from wrapped(note)
    yield from _written(report, folder)


def _notes(report: "TuneReport") -> Iterator[str]:
    """Yield what was kept and why, then what the time did not allow for."""
    from contactlab.schema.tune_report import REPORT
    from contactlab.studies.search.subject import LIMITED
    from contactlab.studies.search.wording import UNJUDGED

    short = {each.name: each.reason for each in report.kept if each.name in LIMITED}
    kept = [
        f"{each.name}: {each.reason}"
        for each in report.kept
        if each.name not in short and each.reason != UNJUDGED
    ]
    yield from (f"kept: {each}" for each in shortened(kept, 6, REPORT))
    yield from (f"note: {name}: {reason}" for name, reason in short.items())
    if any(each.reason == UNJUDGED for each in report.kept):
        yield f"note: {UNJUDGED}"


def _written(report: "TuneReport", folder: Path) -> Iterator[str]:
    from contactlab.schema.tune_report import PATCH, REPORT

    for what, other in (
        ("is as accurate as now", report.as_accurate),
        ("keeps the aim", report.to_aim),
    ):
        if other:
            wrote = f"wrote {folder / other.file}, which {what}: {other.verified.sentence}"
            yield from wrapped(wrote)
    if report.file:
        patch = f", {PATCH}" if (folder / PATCH).is_file() else ""
        yield from wrapped(f"wrote {folder / report.file}{patch} and {REPORT}")
        yield f"next: contactlab {shell_word(folder / report.file)}"
    else:
        yield f"{REPORT} in {folder}"


def _assumed(report: "TuneReport") -> Iterator[str]:
    """Yield what a written model takes for granted, or what may be."""
    if (apart := report.stayed_apart) and (apart.left_out or _saves(apart)):
        yield _apart(apart)
    if fewer := report.fewer_vertices:
        yield (
            f"assumed: {plural(len(fewer.meshes), 'hull')} of fewer vertices, which reach at most "
            f"{1e3 * fewer.within:g} mm less"
        )


def _saves(apart: "StayedApart") -> bool:
    """Return whether leaving collisions out saves time, unless nobody measured it."""
    return apart.price is None or apart.price.high < 1


def _parted(geoms: Sequence[str], bodies: Sequence[object]) -> str:
    """Return how many geoms, and pairs of bodies, there are of what does not touch."""
    counts = (plural(len(geoms), "geom"), f"{plural(len(bodies), 'pair')} of bodies")
    return " and ".join(text for text, some in zip(counts, (geoms, bodies), strict=True) if some)


def _apart(apart: "StayedApart") -> str:
    from contactlab.studies.search.wording import price_text

    what = _parted(apart.geoms, apart.bodies)
    margin = f"{1e3 * apart.margin:g} mm"
    run = f"stayed {margin} apart in all that was run (the task, tilted, and twice its inputs)"
    if apart.left_out:
        return f"assumed: {what} {run}: what brings them together passes through"
    saves = f", at {price_text(apart.price)} of that time" if apart.price else ""
    return f"offered: {what} {run}: --apart {margin.replace(' ', '')} leaves them out{saves}"
