"""`contactlab tune`: from a model to the settings to use, written and proven."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Given, Option, command, flag
from contactlab.command_line.surroundings import say, study_session
from contactlab.command_line.terminal import echo, echo_bytes, print_table
from contactlab.errors import ExpectationError, SweepFileError
from contactlab.printable import shortened

if TYPE_CHECKING:
    from contactlab.schema.study_reports import Candidate, TuneReport

_REALITY = "reality"
_LENGTH, _TIME = "a length, such as 1e-3 or 1mm", "a time, such as 90s, 5min or 1h"


def _text(report: "TuneReport", given: Given) -> None:
    from contactlab.schema.study_reports import PATCH

    folder = opt.study_folder("tune", given["model"], given["output"])
    if given["patch"]:
        if (folder / PATCH).is_file():
            echo_bytes((folder / PATCH).read_bytes())
        return
    echo("\n".join(_head(report)))
    real = report.candidates[0].reality is not None
    errors = ("reality",) if real else ("final error", "peak error")
    header = ("", "settings", *errors, "CPU s per s", "time", "labels")
    print_table(header, [_row(candidate) for candidate in report.candidates])
    echo("\n".join(_details(report, folder)))


def _json(report: "TuneReport", given: Given) -> None:
    del given
    echo(report.model_dump_json(indent=2))


def _failure(report: "TuneReport", given: Given) -> ExpectationError | None:
    if report.proof is not None and report.proof.holds:
        return None
    reasons = [f"{kept.name}: {kept.reason}" for kept in report.kept[-1:]]
    nothing = f"nothing is better than {given['model']} as written"
    return ExpectationError("; ".join([nothing, *reasons]))


@command(
    "examine",
    examples=("tune robot.xml",),
    formats={"text": _text, "json": _json},
    failure=_failure,
)
def tune(
    model: Annotated[
        str | Path,
        Argument("MODEL", "An .xml or .urdf file, a scene, or menagerie:ROBOT.", kind=str),
    ],
    *,
    output: opt.StudyFolder = None,
    goal: Annotated[
        Literal["fastest", "most-accurate"],
        Option(None, "The fastest, or the most accurate that takes no longer than now."),
    ] = "fastest",
    error: Annotated[
        float | str | None,
        Option(
            "METRES",
            "Largest distance from the model as written, by default its own; or reality.",
            kind=str,
        ),
    ] = None,
    budget: Annotated[
        float | str, Option("TIME", "How long it may take: 90s, 5min, 1h.", kind=str)
    ] = "5min",
    free: Annotated[
        Sequence[str],
        Option("NAME", "What may go unexercised, or soften: solref.", kind=list[str]),
    ] = (),
    drop_sensors: Annotated[bool, flag("Leave the model's sensors out.")] = False,
    patch: Annotated[bool, flag("Print the patch, and no more.")] = False,
    figure: opt.Figure = None,
    workers: opt.Workers = None,
    start: opt.Start = None,
    drive: opt.Drive = None,
    duration: opt.Duration = None,
    watch: opt.Watch = (),
    within: opt.Within = (),
    must: opt.Must = (),
    plugin: opt.Plugins = (),
    allow_code: opt.AllowCode = False,
) -> "TuneReport":
    """Find the settings to use, and write the model that has them.

    Numbers are in m, and of `budget` in s. Everything goes to `results/tune/NAME` if `output` is
    left out.

    Raises:
        SceneError: there is no such model, or nothing in it moves.
        SweepFileError: a tolerance is of no metric, or the budget is too short for a proof.
        ExpectationError: runs of the model as written fail.
    """
    from contactlab.studies.tune.tune_request import TuneRequest
    from contactlab.studies.tune.tuning import run

    # What the command line prints; the report says the same either way.
    del patch
    opt.load_plugins(plugin)
    opt.check_figure(figure)
    request = TuneRequest(
        model=str(model),
        goal=goal,
        error=_distance(error),
        budget=_read_positive("--budget", str(budget), _TIME, "s"),
        free=free,
        drop_sensors=drop_sensors,
        task=opt.task_of(start, drive, duration, watch, within, must),
    )
    folder = opt.study_folder("tune", model, output)
    with study_session(folder, workers, allow_code=allow_code) as session:
        report = run(request, session)
    if figure is not None:
        _draw(report, folder, Path(figure))
    return report


def _distance(error: float | str | None) -> float | Literal["reality"] | None:
    if error is None or error == _REALITY:
        return error and "reality"
    return _read_positive("--error", str(error), _LENGTH, "m")


def _draw(report: "TuneReport", folder: Path, figure: Path) -> None:
    from contactlab.charts import save_figure
    from contactlab.pareto.analysis import analyse
    from contactlab.pareto.criteria import Criteria
    from contactlab.pareto.tradeoff_chart import specification
    from contactlab.store.finished_store import Store
    from contactlab.studies.tune.study import COMPARED

    if COMPARED in report.stores:
        store = Store.open(folder / COMPARED)
        error = _REALITY if _REALITY in report.limits else "error_peak"
        save_figure(specification(analyse(store, Criteria(error, report.limits))), figure)
        say(f"drew {figure}")


def _read_positive(option: str, text: str, like: str, kind: str) -> float:
    """Return a number above 0, in a unit of a kind or without one."""
    from contactlab.schema.setting_values import read_quantity

    value, unit = read_quantity(text)
    if not 0 < value < math.inf or unit not in ("", kind):
        raise SweepFileError(f"{option} {text}: write {like}")
    return value


def _head(report: "TuneReport") -> Iterator[str]:
    proof, name = report.proof, report.model
    yield report.task.line
    if proof is None or not proof.holds:
        yield f"{name}: keep it as it is"
    else:
        cost, tuned = proof.tuned.cost, proof.tuned
        ratio = 1 / cost.ratio if cost else math.nan
        name_of_error, unit = ("error", " m") if tuned.reality is None else (_REALITY, "")
        before, after = (_number(_error(each)) + unit for each in (proof.now, tuned))
        error, runs = f"{name_of_error} {after} (now {before})", sum(tuned.labels.values())
        yield f"{name}: {ratio:.2f} times as fast, {error}, in {runs} fresh runs"
    limits = ", ".join(f"{name} <= {limit:.3g}" for name, limit in report.limits.items())
    source = "as asked" if report.asked else "as good as now"
    yield f"  limits   {limits} ({source})"
    ended = f"; the search ended {report.ended}" if report.ended else ""
    yield f"  search   {report.tried} configurations, {report.runs} runs{ended}"


def _row(each: "Candidate") -> tuple[object, ...]:
    settings = ", ".join(f"{name} {value}" for name, value in each.settings.items())
    labels = ", ".join(f"{label} {count}" for label, count in each.labels.items())
    time = "" if each.time is None else f"{each.time:.3g}"
    ratio = "" if each.cost is None else f"x{each.cost.ratio:.2f}"
    errors = (_number(each.error_final),) if each.reality is None else ()
    errors += (_number(_error(each)),)
    return each.standing, settings or "as written", *errors, time, ratio, labels


def _error(each: "Candidate") -> float | None:
    return each.error_peak if each.reality is None else each.reality


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2e}"


def _details(report: "TuneReport", folder: Path) -> Iterator[str]:
    from contactlab.schema.study_reports import PATCH, PROOF, REPORT

    shares = {name: 1 - each.ratio for name, each in report.profile.items() if each.high < 1}
    yield "time: " + (", ".join(f"{name} {share:.0%}" for name, share in shares.items()) or "-")
    if report.masked or report.excluded:
        yield (
            f"exact: {len(report.masked)} geoms and {len(report.excluded)} pairs of bodies cannot "
            "touch, by proof: every run is the same without their collisions, bit for bit"
        )
    lines = [f"{each.file}:{each.line}: {each.element or 'removed'}" for each in report.lines]
    yield from shortened(lines, 12, PATCH)
    kept = [f"{each.name}: {each.reason}" for each in report.kept]
    yield from (f"kept: {each}" for each in shortened(kept, 6, REPORT))
    if report.file:
        patch = f", {PATCH}" if (folder / PATCH).is_file() else ""
        yield f"wrote {folder / report.file}{patch}, {PROOF} and {REPORT}"
        yield f"next: contactlab sweep {folder / PROOF}"
    else:
        yield f"evidence and {REPORT} in {folder}"
