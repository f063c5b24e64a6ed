"""`contactlab tune`: from a model to the settings to use, written and proven."""

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import typer

from contactlab.commands import options as opt
from contactlab.commands.terminal import echo, echo_bytes, print_table, say, study_session
from contactlab.errors import ExpectationError, SweepFileError
from contactlab.printable import shortened
from contactlab.resources import RESULTS

if TYPE_CHECKING:
    from contactlab.schema.study_reports import Candidate, TuneReport

_NONE: Mapping[str, float] = {}
_SECONDS = {"s": 1.0, "min": 60.0, "h": 3600.0}
_REALITY = "reality"
_NUMBER, _TIME = "a number above 0, such as 1e-3", "a time, such as 90s, 5min or 1h"


@opt.helped(
    "tune robot.xml",
    codes="0 as expected, 1 not, 2 bad input, 3 bad store, 4 runs lost, 130 interrupted",
)
def tune(
    model: str = typer.Argument(..., help="An .xml or .urdf file, a scene, or menagerie:ROBOT."),
    folder: Path | None = opt.STUDY_FOLDER,
    *,
    goal: Literal["fastest", "most-accurate"] = typer.Option(
        "fastest", help="The fastest, or the most accurate that takes no longer than now."
    ),
    error: str | None = opt.option(
        "METRES", "Largest distance from the model as written, by default its own; or reality."
    ),
    tolerance: list[str] | None = opt.TOLERANCE,
    budget: str = opt.option("TIME", "How long it may take: 90s, 5min, 1h.", "5min"),
    free: list[str] | None = opt.option("NAME", "What may go unexercised, or soften: solref."),
    drop_sensors: bool = opt.flag("--drop-sensors", "Leave the model's sensors out."),
    patch: bool = opt.flag("--patch", "Print the patch, and no more."),
    figure: Path | None = opt.FIGURE,
    workers: int | None = opt.WORKERS,
    drive: str | None = opt.DRIVE,
    plugin: list[Path] | None = opt.PLUGIN,
    allow_code: bool = opt.ALLOW_CODE,
    output: opt.Format = opt.FORMAT,
) -> None:
    """Find the settings to use, write the model that has them, and prove that it is as good."""
    from contactlab.plan.overrides import drive_option
    from contactlab.schema.study_reports import PATCH
    from contactlab.studies.session import model_name
    from contactlab_tune.tune_request import TuneRequest
    from contactlab_tune.tuning import run

    opt.load_plugins(plugin)
    opt.check_figure(figure)
    request = TuneRequest(
        model=model,
        goal=goal,
        error=error
        if error is None or error == _REALITY
        else _read_positive("--error", error, _NUMBER),
        tolerances=dict(opt.read_limit(each, "tolerance") for each in tolerance or ()),
        budget=_read_positive("--budget", budget, _TIME, _SECONDS),
        free=free or (),
        drop_sensors=drop_sensors,
        drive=drive_option(drive),
    )
    target = folder or RESULTS / "tune" / model_name(model)
    with study_session(target, workers, allow_code=allow_code) as session:
        report = run(request, session)
    if figure is not None:
        _draw(report, target, figure)
    if output == "json":
        echo(report.model_dump_json(indent=2))
    elif not patch:
        echo("\n".join(_head(report)))
        real = report.candidates[0].reality is not None
        errors = ("reality",) if real else ("final error", "peak error")
        header = ("", "settings", *errors, "CPU s per s", "time", "labels")
        print_table(header, [_row(each) for each in report.candidates])
        echo("\n".join(_details(report, target)))
    elif (target / PATCH).is_file():
        echo_bytes((target / PATCH).read_bytes())
    if report.proof is None or not report.proof.holds:
        reasons = [f"{each.name}: {each.reason}" for each in report.kept[-1:]]
        raise ExpectationError("; ".join([f"nothing is better than {model} as written", *reasons]))


def _draw(report: "TuneReport", folder: Path, figure: Path) -> None:
    from contactlab.charts import save_figure
    from contactlab.pareto.analysis import analyse
    from contactlab.pareto.criteria import Criteria
    from contactlab.pareto.tradeoff_chart import specification
    from contactlab.store.finished_store import Store
    from contactlab_tune.study import COMPARED

    if COMPARED in report.stores:
        store = Store.open(folder / COMPARED)
        error = _REALITY if _REALITY in report.limits else "error_peak"
        save_figure(specification(analyse(store, Criteria(error, report.limits))), figure)
        say(f"drew {figure}")


def _read_positive(option: str, text: str, like: str, units: Mapping[str, float] = _NONE) -> float:
    """Return a number above 0; with units, one in any of them."""
    number = text.rstrip("".join(units) + " ")
    try:
        value = float(number) * {"": 1.0, **units}[text.removeprefix(number).strip()]
    except (ValueError, KeyError):
        value = math.nan
    if not 0 < value < math.inf:
        raise SweepFileError(f"{option} {text}: write {like}")
    return value


def _head(report: "TuneReport") -> Iterator[str]:
    proof, name = report.proof, report.model
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
    yield f"  drive    {report.drive}, {report.duration:g} s"
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
