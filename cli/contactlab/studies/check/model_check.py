"""All checks of a model: those of the modules beside this one, and of plug-ins."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from contactlab.engines import find_engine
from contactlab.engines.engine import ChecksRuns
from contactlab.errors import SceneError, SweepFileError, did_you_mean
from contactlab.judge.acceptances import apply_acceptances, stale_acceptances
from contactlab.judge.conclusion import failed_names
from contactlab.judge.limits import LIMITS
from contactlab.mjcf import MODEL_ENGINE
from contactlab.plan.task_options import AS_INFERRED, TaskOptions
from contactlab.run.evidence_record import engine, provenance
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.compiled_scene import CompiledScene
from contactlab.scene.parameters import PARAMETERS
from contactlab.scene.run_setup import actuated_limbs
from contactlab.scene.run_spec import RunSpec
from contactlab.schema.check_report import CheckReport, CheckResult, TaskKind
from contactlab.schema.coverage import Exercised
from contactlab.schema.finding import Acceptance, Finding
from contactlab.schema.task import QPOS0
from contactlab.store.table_layout import record_to_row
from contactlab.studies.check.check_entries import CHECKS, Check
from contactlab.studies.check.check_results import check_result, findings_of, report_of
from contactlab.studies.check.checked_model import (
    NOMINAL_STORE,
    CheckedModel,
    TooLongError,
    axis_value,
    most_steps,
)
from contactlab.studies.check.remedies import find_remedies
from contactlab.studies.check.run_checks import reference_of
from contactlab.studies.session import Session, Values, read_settings
from contactlab.studies.task_verdict import refuse_lengths
from contactlab.writers.markdown import as_markdown
from contactlab.writers.report import ORDER

REPORT, PAGE, REFERENCE = "check.json", "check.md", "reference.json"
_WALKING = 2  # number of actuated limbs from which a free body is taken to walk


@dataclass(frozen=True)
class CheckRequest:
    """Which model to check, and how."""

    model: str  # a shipped scene, a folder, a model file or menagerie:ROBOT
    assign: Sequence[str] = ()  # settings to check it with, `NAME=VALUE` each
    only: Sequence[str] = ()  # names of checks; all if empty
    kind: TaskKind | None = None  # of task; derived from the model if None
    # What replaces parts of the model's task; its limits are of measures, by name.
    task: TaskOptions = AS_INFERRED
    accepted: Sequence[Acceptance] = ()  # findings that are known and accepted
    remedies: bool = True  # whether to look for changes that help


def run(request: CheckRequest, session: Session) -> CheckReport:
    """Check a model; write `check.json`, `check.md` and `reference.json` beside the stores.

    Raises a SceneError if there is no such model or keyframe, or it does not compile; a
    SweepFileError if a setting, or the name of a check or a limit, is wrong; a PolicyError if what
    is accepted is not a finding of any check; an OutputError if the session's folder cannot be
    written; a StoppedError if the session was stopped.
    """
    checks = {name: CHECKS[name] for name in _chosen(request.only)}
    # Raises an error for what no check can find, before anything is run.
    _judged([], request.accepted)
    checked = open_model(request, session)
    session.claim("check", request.model)
    results = [_result(name, check, checked) for name, check in checks.items()]
    findings = _judged(results, request.accepted)
    failing = [finding.name for finding in findings if finding.outcome in {"failed", "warned"}]
    remedies, notes = find_remedies(checks, checked, results, failing if request.remedies else [])
    stale = (
        f"'{acceptance.check}' is accepted ({acceptance.reason}), but does not fail: remove it"
        for acceptance in stale_acceptances(findings, request.accepted)
    )
    report = CheckReport(
        model=request.model,
        scene=checked.scene.name,
        scene_hash=checked.scene.hash,
        task=checked.task,
        verdict=checked.verdict if "task" in checks else None,
        overrides=tuple(_assigned(request)),
        keyframe=None if checked.resolved.keyframe == QPOS0 else checked.resolved.keyframe,
        drive=checked.resolved.drive,
        kind=checked.kind,
        kind_reason=checked.kind_reason,
        settings=checked.resolved.values,
        engine=engine(),
        provenance=provenance(),
        passed=not failed_names(findings),
        checks=tuple(results),
        findings=tuple(findings),
        remedies=remedies,
        notes=(*stale, *checked.notes, *notes),
        not_exercised=_not_exercised(checked),
    )
    session.write(_files(report, checked))
    return report


def open_model(request: CheckRequest, session: Session) -> CheckedModel:
    """Open a model for its checks; what the request leaves open depends on it, or on its scene.

    Raises a SceneError if there is no such scene, or it does not compile; a SweepFileError if a
    setting is wrong (all are named).
    """
    refuse_lengths(request.task)
    _require_known("limit", request.task.limits, replaceable_limits())
    scenes, reference = SceneLoader(Path()), request.model
    scene = scenes.open(reference)
    values, sweep = read_settings(scenes, reference, _assigned(request), ("duration", "must"))
    engine = find_engine(str(values.get("engine", MODEL_ENGINE)))
    if not isinstance(engine, ChecksRuns):
        raise SweepFileError(
            f"--set engine: a check goes over its runs a second time, which the {engine.name} "
            "engine cannot"
        )
    resolved = scene.resolve(values, 0, None)
    if not 0 < resolved.timestep < math.inf:
        raise SceneError(
            f"{scene.source.model}: its timestep is {resolved.timestep:g} s; write one above 0 "
            "there, or `--set timestep=`"
        )
    base = scene.base(resolved.structure)
    kind, reason = _kind(base, request.kind)
    bare, steps = scene.source.manifest is None, most_steps(base.model)
    most = steps * resolved.timestep
    shorter = bare and sweep.duration is None and most < scene.duration
    note = (
        f"runs take {most:g} s, not {scene.duration:g}: longer ones take more than {steps:,} "
        "steps; --set duration=SECONDS makes them"
    )
    return CheckedModel(
        reference=reference,
        scenes=scenes,
        session=session,
        values=_settings(resolved, values),
        duration=most if shorter else sweep.duration or scene.duration,
        drive=request.task.drive,
        limits=request.task.limits,
        options=request.task,
        kind=kind,
        kind_reason=reason,
        notes=(note,) * shorter,
    )


def _assigned(request: CheckRequest) -> list[str]:
    return [*request.assign, *request.task.settings]


def _settings(resolved: RunSpec, values: Values) -> dict[str, object]:
    """Replace parts of settings, such as `solref.timeconst`, by the whole settings they change."""
    whole: dict[str, object] = {}
    for name, value in values.items():
        changed = PARAMETERS[name].sets if name in PARAMETERS else name
        setting = resolved.settings[changed] if name in PARAMETERS else value
        whole[changed] = axis_value(changed, setting)
    return whole


def _kind(base: CompiledScene, asked: TaskKind | None) -> tuple[TaskKind, str]:
    """Return the kind of task and why: locomotion for a free body with several actuated limbs."""
    if asked is not None:
        return asked, "as asked"
    limbs = actuated_limbs(base.model)
    name = max(limbs, key=lambda limb: limbs[limb], default="")
    if limbs.get(name, 0) >= _WALKING:
        return "locomotion", f"'{name}' is free and has {limbs[name]} actuated limbs"
    return "manipulation", "no free body has several actuated limbs"


def _chosen(only: Sequence[str]) -> list[str]:
    _require_known("check", only, CHECKS)
    return [name for name in CHECKS if name in only or not only]


def _require_known(kind: str, names: Iterable[str], known: Iterable[str]) -> None:
    for name in (given for given in names if given not in known):
        hint = did_you_mean(name, known)
        raise SweepFileError(f"no {kind} '{name}'{hint}; there are {', '.join(known)}")


def _not_exercised(checked: CheckedModel) -> tuple[str, ...]:
    """Return what of the model its nominal runs left alone: no check speaks of it."""
    if not checked.stores(NOMINAL_STORE):
        return ()
    return Exercised.of(record_to_row(run.record) for run in checked.nominals).idle()


def _result(name: str, check: Check, checked: CheckedModel) -> CheckResult:
    try:
        return check(checked)
    except TooLongError as error:
        return check_result(name, "whether it can be run at all", [], [str(error)])


def _judged(results: Sequence[CheckResult], accepted: Sequence[Acceptance]) -> list[Finding]:
    """Return all findings, those first that fail and are not accepted."""
    found = [finding for result in results for finding in findings_of(result)]
    judged = apply_acceptances(found, accepted, datetime.now(UTC).date(), _known_findings())
    return sorted(judged, key=lambda finding: ORDER.index(finding.outcome))


def replaceable_limits() -> list[str]:
    """Return the names of the limits that a request may replace by its own."""
    return [*(name for name, limit in LIMITS.items() if limit.value is not None), "timestep"]


def _known_findings() -> set[str]:
    return {*LIMITS, *(name for check in CHECKS.values() for name in check.findings)}


def _files(report: CheckReport, checked: CheckedModel) -> dict[str, str]:
    files = {REPORT: report.model_dump_json(indent=2) + "\n", PAGE: as_markdown(report_of(report))}
    if checked.stores(NOMINAL_STORE) and checked.nominal.record.trajectory_hash is not None:
        files[REFERENCE] = reference_of(checked.nominal).model_dump_json(indent=2) + "\n"
    return files
