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
from contactlab.printable import shell_word, shortened, wrapped
from contactlab.rendering.amounts import format_percent

if TYPE_CHECKING:
    from contactlab.schema.tune_report import Candidate, CurrentVerdict, FarPairs, TuneReport
    from contactlab.studies.search.tune_request import TuneRequest

_MAX_UNCHANGED = 6  # settings that the text lists
_TIME = "a time, such as 90s, 5min or 1h"
_ERROR = "a share, such as 2%, or with --error-at a number in the unit of the observed output"


def _text(report: "TuneReport", given: Given) -> None:
    from contactlab.schema.tune_report import PATCH

    folder = opt.study_folder("tune", given["model"], given["output"])
    if given["patch"]:
        if report.recommended and (folder / PATCH).is_file():
            echo_bytes((folder / PATCH).read_bytes())
        return
    print_search(report, folder)


def failure(report: "TuneReport", given: Given) -> ExpectationError | None:
    """Return the error if no candidate meets the target."""
    del given
    if report.target_met or report.recommended:
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
    max_time: opt.MaxTime = "2min",
    drop_sensors: Annotated[
        bool, flag("Remove the model's sensors, if your program does not read them.")
    ] = False,
    skip_pairs_beyond: Annotated[
        float | str | None,
        Option(
            "LENGTH",
            "Ignore collisions between bodies that stayed this far apart in every run, e.g. 5cm.",
            kind=str,
        ),
    ] = None,
    simplify_hulls: Annotated[
        float | str | None,
        Option(
            "LENGTH",
            "Simplify convex hulls, moving the surface by at most this distance, e.g. 1mm.",
            kind=str,
        ),
    ] = None,
    patch: Annotated[bool, flag("Print only the patch.")] = False,
    figure: opt.Figure = None,
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
    request = TuneRequest(
        model=str(model),
        task=opt.task_of(**task),
        error=read_error(error),
        real_time=_positive_rate(real_time),
        observed=observed if error_at else (),
        error_at=error_at,
        max_time=seconds_of(max_time),
        drop_sensors=drop_sensors,
        skip_pairs_beyond=read_length(skip_pairs_beyond, "--skip-pairs-beyond", "5cm or 0.05"),
        simplify_hulls=read_length(simplify_hulls, "--simplify-hulls", "1mm or 0.001"),
    )
    opt.load_plugins(plugin)
    folder = opt.study_folder("tune", model, output)
    return search_settings(request, folder, workers, figure, allow_code=allow_code)


def search_settings(
    request: "TuneRequest",
    folder: Path,
    workers: int | None,
    figure: str | Path | None,
    *,
    allow_code: bool,
    known: Sequence[Path] = (),
) -> "TuneReport":
    """Search, unless a folder has the report of the same question; draw the figure if requested."""
    begin = time.monotonic()  # imports count as part of the time limit
    from contactlab.run.worker_pool import worker_count
    from contactlab.studies.search.result_cache import find_cached_report
    from contactlab.studies.search.tuning import tune_model
    from contactlab.tasks.session import Session

    opt.check_figure(figure)
    session = Session(folder, worker_count(workers), notify=say, allow_code=allow_code)
    report = find_cached_report(request, session, known) or tune_model(request, session, begin)
    if figure is not None:
        from contactlab.charts import save_figure
        from contactlab.studies.search.search_chart import specification

        save_figure(specification(report), Path(figure))
        say(f"drew {figure}")
    return report


def read_error(error: float | str | None) -> float | None:
    """Return the target error as a number; 2% is 0.02."""
    from contactlab.schema.setting_values import read_quantity

    if error is None:
        return None
    value, unit = read_quantity(str(error))
    if not 0 < value < math.inf or unit not in ("", "m", "rad", "1"):
        raise SweepFileError(f"--error {error}: write {_ERROR}")
    return value


def seconds_of(text: float | str, option: str = "--max-time") -> float:
    """Return the time limit of an option [s]."""
    from contactlab.schema.setting_values import read_quantity

    value, unit = read_quantity(str(text))
    if not 0 < value < math.inf or unit not in ("", "s"):
        raise SweepFileError(f"{option} {text}: write {_TIME}")
    return value


def read_length(text: float | str | None, option: str, such_as: str) -> float | None:
    """Return the length of an option [m]."""
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
    shown = [("current", report.current)]
    for standing, candidate in (
        ("recommended", report.recommended),
        ("closest", report.closest),
        ("equal error", report.equal_error and report.equal_error.candidate),
    ):
        if candidate:
            shown.append((standing, candidate))
    header = ("", "settings", "timestep [s]", "error", "over seeds", "worst body", "time")
    print_table(header, [_row(standing, candidate, report) for standing, candidate in shown])
    echo("\n".join(_details(report, folder)))


def _head(report: "TuneReport") -> Iterator[str]:
    target = report.target
    yield from wrapped(report.task.line)
    yield from wrapped(f"{report.model}: {report.sentence}")
    limit = _number(target.limit, report)
    match target.kind:
        case "as written":
            yield f"  target     error at most {limit}, as the model as written"
        case "tolerance":
            yield f"  target     error at most {limit} (the tolerance)"
        case "real time":
            yield f"  target     the least error at {target.real_time:g}x real time"
        case _:
            yield f"  target     error at most {limit}, as requested"
    if report.current_verdict:
        yield from wrapped(f"verdict    {_verdict(report.current_verdict, report)}", "  ")
    if target.unit == "1":
        yield from wrapped(
            "errors     residual force as a share of the real forces, against the model as written "
            f"at a timestep of {report.reference_step:g} s",
            "  ",
        )
    if target.divergence:
        yield from wrapped(f"motion     {target.divergence}", "  ")
    yield from _search_lines(report)


def _search_lines(report: "TuneReport") -> Iterator[str]:
    from contactlab.studies.search.report_text import ending_text, no_speedup_text

    yield from wrapped(f"search     {ending_text(report)}, {report.seconds:.0f} s", "  ")
    yield f"  speed      {report.real_time:.3g}x real time as written, on one core"
    if why := no_speedup_text(report):
        yield from wrapped(f"limits     {why}", "  ")


def _verdict(verdict: "CurrentVerdict", report: "TuneReport") -> str:
    error = (
        "MuJoCo gave up"
        if verdict.numerical_error is None
        else f"numerical error {format_percent(verdict.numerical_error)}"
    )
    text = f"{verdict.verdict} as written, {error} along its own motion"
    count = len(report.task.seeds)
    if len(verdict.seeds) == count:
        return f"{text}, as in `contactlab MODEL`"
    few = out_of(len(verdict.seeds), count, "seed")
    return f"{text}, on {few} only; `contactlab MODEL` judges all {count}"


def _row(standing: str, candidate: "Candidate", report: "TuneReport") -> tuple[object, ...]:
    from contactlab.studies.search.configuration import format_settings
    from contactlab.studies.search.report_text import time_ratio_text

    time = "" if candidate.cost is None else f"work x{candidate.cost:.2g}"
    time = time if candidate.time_ratio is None else time_ratio_text(candidate.time_ratio)
    spread = f"{_number(candidate.low, report)} to {_number(candidate.high, report)}"
    settings = format_settings(candidate.settings) or (
        "as written" if standing == "current" else ""
    )
    error = _number(candidate.error, report)
    return standing, settings, f"{candidate.timestep:g}", error, spread, candidate.body, time


def _number(value: float | None, report: "TuneReport") -> str:
    if value is None:
        return "gave up"
    return (
        format_percent(value) if report.target.unit == "1" else f"{value:.2e} {report.target.unit}"
    )


def _details(report: "TuneReport", folder: Path) -> Iterator[str]:
    from contactlab.schema.tune_report import PATCH

    if report.masked or report.excluded:
        yield from wrapped(
            f"unused: {_count_pairs(report.masked, report.excluded)} provably cannot touch: "
            "without their collisions the motion is the same, bit for bit"
        )
    if report.disabled_flags:
        yield f"unused: {' and '.join(report.disabled_flags)}: no state depends on it; turned off"
    for assumption in _assumptions(report):
        yield from wrapped(assumption)
    if report.verified:
        fresh = report.verified.seeds
        seeds = f"seed{'s' * (len(fresh) > 1)} {', '.join(map(str, fresh))}"
        yield from wrapped(f"verified on {seeds}: {report.verified.sentence}")
    lines = [f"{each.file}:{each.line}: {each.element or 'removed'}" for each in report.lines]
    yield from shortened(lines, 12, PATCH)
    for note in _notes(report):
        yield from wrapped(note)
    yield from _written_files(report, folder)


def _notes(report: "TuneReport") -> Iterator[str]:
    """Yield the settings that were not changed and why, then the effects of the time limit."""
    from contactlab.schema.tune_report import REPORT
    from contactlab.studies.search.report_text import UNVERIFIED
    from contactlab.studies.search.tuning_problem import LIMITED

    limited = {each.name: each.reason for each in report.not_changed if each.name in LIMITED}
    unchanged = [
        f"{each.name} ({each.reason})"
        for each in report.not_changed
        if each.name not in limited and each.reason != UNVERIFIED
    ]
    yield from (f"Not changed: {each}." for each in unchanged[:_MAX_UNCHANGED])
    if (more := len(unchanged) - _MAX_UNCHANGED) > 0:
        yield f"Not changed: {more} more settings, listed in {REPORT}."
    yield from (f"note: {name}: {reason}" for name, reason in limited.items())
    if any(each.reason == UNVERIFIED for each in report.not_changed):
        yield f"note: {UNVERIFIED}"


def _written_files(report: "TuneReport", folder: Path) -> Iterator[str]:
    from contactlab.schema.tune_report import PATCH, REPORT

    if other := report.equal_error:
        yield from wrapped(f"wrote {folder / other.file} (equal error): {other.verified.sentence}")
    if report.file:
        patch = f", {PATCH}" if (folder / PATCH).is_file() else ""
        yield from wrapped(f"wrote {folder / report.file}{patch} and {REPORT}")
        yield f"next: contactlab {shell_word(folder / report.file)}"
    else:
        yield f"{REPORT} in {folder}"


def _assumptions(report: "TuneReport") -> Iterator[str]:
    """Yield the assumptions of the written model, or those that it could make."""
    if (pairs := report.far_pairs) and (pairs.removed or _saves_time(pairs)):
        yield _far_pairs_text(pairs)
    if hulls := report.simplified_hulls:
        yield (
            f"assumed: {plural(len(hulls.meshes), 'hull')} with fewer vertices, at most "
            f"{1e3 * hulls.max_distance:g} mm inside the original"
        )


def _saves_time(pairs: "FarPairs") -> bool:
    """Return whether removing their collisions saves work; true if it was not counted."""
    from contactlab.schema.time_ratio import LEAST_SAVING

    return pairs.cost is None or pairs.cost < 1 - LEAST_SAVING


def _count_pairs(geoms: Sequence[str], bodies: Sequence[object]) -> str:
    counts = (plural(len(geoms), "geom"), f"{plural(len(bodies), 'pair')} of bodies")
    return " and ".join(text for text, some in zip(counts, (geoms, bodies), strict=True) if some)


def _far_pairs_text(pairs: "FarPairs") -> str:
    count = _count_pairs(pairs.geoms, pairs.bodies)
    distance = f"{1e3 * pairs.distance:g} mm"
    text = (
        f"{count} stayed at least {distance} apart in every run (the task, tilted, and with twice "
        "its inputs)"
    )
    if pairs.removed:
        return f"assumed: {text}. If they meet, they now pass through each other"
    ratio = f" at x{pairs.cost:.2g} work" if pairs.cost else ""
    option = f"--skip-pairs-beyond {distance.replace(' ', '')}"
    return f"option: {text}. {option} ignores their collisions{ratio}"
