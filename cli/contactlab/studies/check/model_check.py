"""All checks of a model, and their page."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from contactlab.errors import SweepFileError, did_you_mean
from contactlab.run.evidence_record import engine, provenance
from contactlab.schema.check_report import (
    Change,
    CheckName,
    CheckReport,
    CheckResult,
    Measure,
    TaskKind,
)
from contactlab.studies.check.checked_model import CheckRunner, open_model
from contactlab.studies.check.contact_margin_check import check_contact_margin
from contactlab.studies.check.flat_contact_check import check_flat_contact
from contactlab.studies.check.free_motion_check import check_free_motion
from contactlab.studies.check.hold_check import check_hold
from contactlab.studies.check.repeat_check import check_repeat, reference_of
from contactlab.studies.check.timestep_check import check_timestep
from contactlab.studies.session import Session

REPORT, PAGE, REFERENCE = "check.json", "check.md", "reference.json"


_CHECKS: Mapping[CheckName, Callable[[CheckRunner], CheckResult]] = {
    "timestep": check_timestep,
    "free_motion": check_free_motion,
    "flat_contact": check_flat_contact,
    "hold": check_hold,
    "repeat": check_repeat,
    "shells": check_contact_margin,
}


@dataclass(frozen=True)
class CheckRequest:
    """Which model to check, and how.

    Attributes:
        model: a shipped scene, a folder, a model file or menagerie:ROBOT.
        assign: settings to check it with, `NAME=VALUE` each.
        only: names of checks; all if empty.
        kind: of task; derived from the model if None.
    """

    model: str
    assign: Sequence[str] = ()
    only: Sequence[str] = ()
    kind: TaskKind | None = None


def run(request: CheckRequest, session: Session) -> CheckReport:
    """Check a model; write `check.json`, `check.md` and `reference.json` beside the stores.

    Raises:
        SceneError: there is no such model or keyframe, or it does not compile.
        SweepFileError: a setting or the name of a check is wrong.
        OutputError: the session's folder cannot be written.
        StoppedError: the session was stopped.
    """
    names = _chosen(request.only)
    checked = open_model(request.model, request.assign, request.kind)
    session.claim("check", request.model)
    runner = CheckRunner(checked, session)
    results = tuple(_CHECKS[name](runner) for name in names)
    report = CheckReport(
        model=request.model,
        scene=checked.scene.name,
        scene_hash=checked.scene.hash,
        overrides=checked.given,
        keyframe=checked.keyframe,
        kind=checked.kind,
        kind_reason=checked.kind_reason,
        settings=checked.resolved.values,
        engine=engine(),
        provenance=provenance(),
        passed=all(each.verdict != "fail" for each in results),
        checks=results,
    )
    session.write(_files(report, runner))
    return report


def _chosen(only: Sequence[str]) -> list[CheckName]:
    for name in only:
        if name not in _CHECKS:
            hint = did_you_mean(name, _CHECKS)
            raise SweepFileError(f"no check '{name}'{hint}; there are {', '.join(_CHECKS)}")
    return [name for name in _CHECKS if name in only or not only]


def _files(report: CheckReport, runner: CheckRunner) -> dict[str, str]:
    files = {REPORT: report.model_dump_json(indent=2) + "\n", PAGE: page(report)}
    if runner.has_nominal and runner.nominal.record.trajectory_hash is not None:
        files[REFERENCE] = reference_of(runner.nominal).model_dump_json(indent=2) + "\n"
    return files


def page(report: CheckReport) -> str:
    """Return a report as a Markdown page."""
    return "\n".join([*_head(report), *_overview(report), *_checks(report)]) + "\n"


def _head(report: CheckReport) -> Iterator[str]:
    yield f"# {report.scene}: {'passes' if report.passed else 'fails'}"
    yield ""
    given = "".join(f" --set '{each}'" for each in report.overrides)
    yield f"    contactlab check {report.model}{given}"
    yield ""
    start = f"keyframe `{report.keyframe}`" if report.keyframe else "its initial state"
    yield (
        f"Model `{report.model}` ({report.scene_hash}), from {start}, for {report.kind} "
        f"({report.kind_reason}); {report.engine.name} {report.engine.version}."
    )
    yield ""


def _overview(report: CheckReport) -> Iterator[str]:
    yield "| check | verdict | result |"
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
    yield f"Criterion: {check.asks}."
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
        verdict = "" if each.holds is None else "holds" if each.holds else "**violated**"
        limit = "" if each.limit is None else _number(each.limit, each.unit)
        name, of = each.name.replace("_", " "), _cell(each.of or "")
        yield f"| {name} | {of} | {_number(each.value, each.unit)} | {limit} | {verdict} |"
    yield ""


def _number(value: float | None, unit: str) -> str:
    if value is None:
        return "none"
    return f"{value:.4g}" + ("" if unit == "1" else f" {unit}")


def _change(change: Change) -> Iterator[str]:
    heads = {True: "This fixes it", False: "This does not fix it", None: "Suggested change"}
    yield f"{heads[change.cures]}: {change.shown}"
    yield ""
    yield "```xml"
    yield from change.lines
    yield "```"
    yield ""


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
