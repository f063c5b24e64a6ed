"""All checks of a model, and the files that they leave."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast, get_args

from contactlab.errors import SweepFileError, did_you_mean
from contactlab.run.evidence_record import engine, provenance
from contactlab.run.tasks import BeginCallback, ProgressCallback, Stop
from contactlab.schema import Change, CheckName, CheckReport, CheckResult, Measure, TaskKind
from contactlab.store import atomic_write, write_error
from contactlab.studies.check.checked_model import CheckRunner, open_model
from contactlab.studies.check.contact_margin_check import check_contact_margin
from contactlab.studies.check.flat_contact_check import check_flat_contact
from contactlab.studies.check.free_motion_check import check_free_motion
from contactlab.studies.check.hold_check import check_hold
from contactlab.studies.check.repeat_check import check_repeat, reference_of
from contactlab.studies.check.timestep_check import check_timestep, kind_of

CHECKS: tuple[CheckName, ...] = get_args(CheckName)
REPORT, PAGE, REFERENCE = "check.json", "check.md", "reference.json"


@dataclass(frozen=True)
class CheckRequest:
    """Which model to check, and how.

    Attributes:
        model: a shipped scene, a folder, a model file or another reference to a scene.
        folder: where stores, report and page go.
        assign: `NAME=VALUE`, as typed.
        only: names of checks; all if empty.
        kind: of task; told from the model if None.
        workers: processes.
    """

    model: str
    folder: Path
    assign: Sequence[str] = ()
    only: Sequence[str] = ()
    kind: TaskKind | None = None
    workers: int = 0


def check_model(
    ask: CheckRequest, begin: BeginCallback, progress: ProgressCallback, stop: Stop | None = None
) -> CheckReport:
    """Check a model; write `check.json`, `check.md` and `reference.json` beside the stores.

    Args:
        ask: what to check.
        begin: told how many runs a store has, and how many of them are done already.
        progress: told of runs as they finish.
        stop: set when it should end soon.

    Raises:
        SceneError: there is no such model or keyframe, or it does not compile.
        SweepFileError: an option is wrong.
        OutputError: the folder cannot be written.
        StoppedError: it was told to stop.
    """
    names = _chosen(ask.only)
    target = open_model(ask.model, ask.assign)
    kind, why = kind_of(target, ask.kind)
    bench = CheckRunner(target, ask.folder, ask.workers, begin, progress, stop)
    checks: dict[CheckName, Callable[[CheckRunner], CheckResult]] = {
        "timestep": lambda bench: check_timestep(bench, kind),
        "free_motion": check_free_motion,
        "flat_contact": check_flat_contact,
        "hold": check_hold,
        "repeat": check_repeat,
        "shells": check_contact_margin,
    }
    results = tuple(checks[name](bench) for name in names)
    report = CheckReport(
        model=ask.model,
        scene=target.scene.name,
        scene_hash=target.scene.hash,
        overrides=target.given,
        keyframe=target.keyframe,
        kind=kind,
        kind_reason=why,
        settings=target.resolved.values,
        engine=engine(),
        provenance=provenance(),
        passed=all(each.verdict != "fail" for each in results),
        checks=results,
    )
    _write(ask.folder, report, bench)
    return report


def _chosen(only: Sequence[str]) -> list[CheckName]:
    for name in only:
        if name not in CHECKS:
            hint = did_you_mean(name, CHECKS)
            raise SweepFileError(f"no check '{name}'{hint}; there are {', '.join(CHECKS)}")
    chosen = [name for name in CHECKS if name in only or not only]
    return cast("list[CheckName]", chosen)


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise write_error(folder, error) from error


def _write(folder: Path, report: CheckReport, bench: CheckRunner) -> None:
    _make(folder)
    files = {REPORT: report.model_dump_json(indent=2) + "\n", PAGE: page(report)}
    if bench.has_own and bench.own.record.trajectory_hash is not None:
        files[REFERENCE] = reference_of(bench.own).model_dump_json(indent=2) + "\n"
    for name, text in files.items():
        with atomic_write(folder / name) as path:
            path.write_text(text, encoding="utf-8")


def page(report: CheckReport) -> str:
    """Return a report as a Markdown page."""
    return "\n".join([*_head(report), *_overview(report), *_checks(report)]) + "\n"


def _head(report: CheckReport) -> Iterator[str]:
    yield f"# {report.scene}: {'passes' if report.passed else 'fails'}"
    yield ""
    given = "".join(f" --set '{each}'" for each in report.overrides)
    yield f"    contactlab check {report.model}{given}"
    yield ""
    start = f"keyframe `{report.keyframe}`" if report.keyframe else "its own start"
    yield (
        f"Model `{report.model}` ({report.scene_hash}), from {start}, for {report.kind} "
        f"({report.kind_reason}); {report.engine.name} {report.engine.version}."
    )
    yield ""


def _overview(report: CheckReport) -> Iterator[str]:
    yield "| check | verdict | what came out |"
    yield "|---|---|---|"
    for each in report.checks:
        yield f"| {each.name} | {each.verdict} | {_cell(each.reason)} |"
    yield ""


def _checks(report: CheckReport) -> Iterator[str]:
    for each in report.checks:
        yield from _check(each)


def _check(check: CheckResult) -> Iterator[str]:
    yield f"## {check.name}: {check.verdict}"
    yield ""
    yield f"Asked: {check.asks}."
    yield ""
    yield f"{check.reason[:1].upper()}{check.reason[1:]}."
    yield ""
    if check.measures:
        yield from _measures(check.measures)
    for note in check.notes:
        yield f"- {note}"
    if check.notes:
        yield ""
    for change in check.changes:
        yield from _change(change)
    if check.stores:
        yield f"Evidence: {', '.join(f'`{each}`' for each in check.stores)}."
        yield ""


def _measures(measures: tuple[Measure, ...]) -> Iterator[str]:
    yield "| number | of | value | limit | |"
    yield "|---|---|---|---|---|"
    for each in measures:
        verdict = "" if each.holds is None else "holds" if each.holds else "**missed**"
        limit = "" if each.limit is None else _number(each.limit, each.unit)
        name, of = each.name.replace("_", " "), _cell(each.of or "")
        yield f"| {name} | {of} | {_number(each.value, each.unit)} | {limit} | {verdict} |"
    yield ""


def _number(value: float | None, unit: str) -> str:
    if value is None:
        return "none"
    return f"{value:.4g}" + ("" if unit == "1" else f" {unit}")


def _change(change: Change) -> Iterator[str]:
    heads = {True: "This cures it", False: "This does not cure it", None: "To change"}
    yield f"{heads[change.cures]}: {change.shown}"
    yield ""
    yield "```xml"
    yield from change.lines
    yield "```"
    yield ""


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
