"""All checks of a model."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime

from contactlab.comparison.policies import apply_acceptances, stale_acceptances
from contactlab.errors import SweepFileError, did_you_mean
from contactlab.run.evidence_record import engine, provenance
from contactlab.schema.check_report import CheckName, CheckReport, CheckResult, Finding, TaskKind
from contactlab.schema.coverage import Exercised
from contactlab.schema.drive import Drive
from contactlab.schema.judged_check import AcceptedCheck
from contactlab.store.table_layout import record_to_row
from contactlab.studies.check.check_page import page
from contactlab.studies.check.check_results import LIMITS, Limits, findings_of, not_applicable
from contactlab.studies.check.check_runner import CheckRunner, TooLongError
from contactlab.studies.check.checked_model import open_model
from contactlab.studies.check.contact_margin_check import check_contact_margin
from contactlab.studies.check.flat_contact_check import check_flat_contact
from contactlab.studies.check.free_motion_check import check_free_motion
from contactlab.studies.check.hold_check import check_hold
from contactlab.studies.check.remedies import Check, find_remedies
from contactlab.studies.check.repeat_check import check_repeat, reference_of
from contactlab.studies.check.timestep_check import check_timestep
from contactlab.studies.session import Session

REPORT, PAGE, REFERENCE = "check.json", "check.md", "reference.json"
_CHECKS: Mapping[CheckName, Check] = {
    "timestep": check_timestep,
    "free_motion": check_free_motion,
    "flat_contact": check_flat_contact,
    "hold": check_hold,
    "repeat": check_repeat,
    "shells": check_contact_margin,
}
_KNOWN = {*LIMITS, "inertia_not_positive", "inertia_triangle", "inertia_balanced"}
_ORDER = ("failed", "warned", "noted", "skipped", "passed")


@dataclass(frozen=True)
class CheckRequest:
    """Which model to check, and how.

    Attributes:
        model: a shipped scene, a folder, a model file or menagerie:ROBOT.
        assign: settings to check it with, `NAME=VALUE` each.
        only: names of checks; all if empty.
        kind: of task; derived from the model if None.
        drive: what drives it; the default for such a model if None.
        limits: limits that replace those of the checks, by the name of the measure.
        accepted: findings that are known and accepted.
        remedies: whether to look for changes that help.
    """

    model: str
    assign: Sequence[str] = ()
    only: Sequence[str] = ()
    kind: TaskKind | None = None
    drive: Drive | None = None
    limits: Mapping[str, float] = field(default_factory=dict[str, float])
    accepted: Sequence[AcceptedCheck] = ()
    remedies: bool = True


def run(request: CheckRequest, session: Session) -> CheckReport:
    """Check a model; write `check.json`, `check.md` and `reference.json` beside the stores.

    Raises:
        SceneError: there is no such model or keyframe, or it does not compile.
        SweepFileError: a setting, or the name of a check or a limit, is wrong.
        PolicyError: what is accepted is not a finding of any check.
        OutputError: the session's folder cannot be written.
        StoppedError: the session was stopped.
    """
    checks: dict[CheckName, Check] = {name: _CHECKS[name] for name in _chosen(request.only)}
    # Raises an error for what no check can find, before anything is run.
    _judged([], request.accepted)
    checked = open_model(
        request.model,
        request.assign,
        request.kind,
        drive=request.drive,
        limits=Limits(request.limits),
    )
    session.claim("check", request.model)
    runner = CheckRunner(checked, session)
    results = [_result(name, check, runner) for name, check in checks.items()]
    findings = _judged(results, request.accepted)
    failing = [each.name for each in findings if each.outcome in {"failed", "warned"}]
    aims = failing if request.remedies else []
    remedies, notes = find_remedies(checks, runner, results, aims)
    stale = (
        f"'{each.check}' is accepted ({each.reason}), but does not fail: remove it"
        for each in stale_acceptances(findings, request.accepted)
    )
    report = CheckReport(
        model=request.model,
        scene=checked.scene.name,
        scene_hash=checked.scene.hash,
        overrides=checked.given,
        keyframe=checked.keyframe,
        drive=checked.scene.drive.drive,
        kind=checked.kind,
        kind_reason=checked.kind_reason,
        settings=checked.resolved.values,
        engine=engine(),
        provenance=provenance(),
        passed=all(each.outcome != "failed" for each in findings),
        checks=tuple(results),
        findings=tuple(findings),
        remedies=remedies,
        notes=(*stale, *notes, *_not_exercised(runner)),
    )
    session.write(_files(report, runner))
    return report


def _chosen(only: Sequence[str]) -> list[CheckName]:
    for name in only:
        if name not in _CHECKS:
            hint = did_you_mean(name, _CHECKS)
            raise SweepFileError(f"no check '{name}'{hint}; there are {', '.join(_CHECKS)}")
    return [name for name in _CHECKS if name in only or not only]


def _not_exercised(runner: CheckRunner) -> Iterator[str]:
    """Yield which parts of the model its nominal run left alone: no check speaks of them."""
    if runner.has_nominal:
        exercised = Exercised.of([record_to_row(runner.nominal.record)])
        if lack := exercised.lack(exercised.present):
            yield f"not exercised: {lack}"


def _result(name: CheckName, check: Check, runner: CheckRunner) -> CheckResult:
    try:
        return check(runner)
    except TooLongError as error:
        return not_applicable(name, "whether it can be run at all", str(error))


def _judged(results: Sequence[CheckResult], accepted: Sequence[AcceptedCheck]) -> list[Finding]:
    """Return all findings, those first that fail and are not accepted."""
    found = [each for result in results for each in findings_of(result)]
    judged = apply_acceptances(found, accepted, datetime.now(UTC).date(), _KNOWN)
    return sorted(judged, key=lambda each: _ORDER.index(each.outcome))


def _files(report: CheckReport, runner: CheckRunner) -> dict[str, str]:
    files = {REPORT: report.model_dump_json(indent=2) + "\n", PAGE: page(report)}
    if runner.has_nominal and runner.nominal.record.trajectory_hash is not None:
        files[REFERENCE] = reference_of(runner.nominal).model_dump_json(indent=2) + "\n"
    return files
