"""Finds an earlier report for the same model, task, target and options."""

from dataclasses import replace
from pathlib import Path

from pydantic import ValidationError

from contactlab.modifications.modification import ReductionName
from contactlab.scene.mujoco_versions import VERSION
from contactlab.schema.tune_report import REPORT, TuneReport
from contactlab.studies.examine.judged_model import judge_as_examined
from contactlab.studies.search.tune_request import TuneRequest, refuse_contradictions
from contactlab.tasks.checked_model import open_model
from contactlab.tasks.session import Session


def find_cached_report(request: TuneRequest, session: Session) -> TuneReport | None:
    """Return the report of the same question in the folder of a session, or None.

    A report that the time limit ended, or with missing files, does not count.

    Raises:
        SceneError: there is no such model, or it does not compile.
        SweepFileError: the tolerance is not a share, or options contradict each other.
        OutputError: the folder cannot be written, or has another model's results.
    """
    refuse_contradictions(request)
    report = _read_report(session.folder)
    if report is None:
        return None
    session = replace(session, folder=session.folder.resolve())
    examined = open_model(request.model, session, request.task)
    if (report.scene_hash, report.mujoco) != (examined.scene.hash, VERSION):
        return None
    if not _is_same_question(request, report):
        return None
    return report if report.task == judge_as_examined(examined).task else None


def _read_report(place: Path) -> TuneReport | None:
    try:
        report = TuneReport.model_validate_json((place / REPORT).read_bytes())
    except (OSError, ValidationError):
        return None
    other = report.equal_error.file if report.equal_error else None
    files = [file for file in (report.file, other) if file]
    return report if all((place / file).is_file() for file in files) else None


def _is_same_question(request: TuneRequest, report: TuneReport) -> bool:
    """Return whether a report of the same model and task has the same target and options."""
    target = report.target
    stored_limit = target.limit if target.kind in ("error", "forward error") else None
    requested_error = request.error
    if requested_error is not None and request.error_at is None:
        requested_error = min(requested_error, target.tolerance)
    reductions = dict[ReductionName, float | None]()
    if report.far_pairs and report.far_pairs.removed:
        reductions["far-pairs"] = report.far_pairs.distance
    if report.simplified_hulls:
        reductions["hulls"] = report.simplified_hulls.max_distance
    if report.removed_sensors:
        reductions["sensors"] = None
    same_work = report.ended == "complete" or report.max_cpu == request.max_cpu
    return (
        report.ended != "time"
        and same_work
        and (
            (requested_error, request.real_time, tuple(request.observed), request.error_at)
            == (stored_limit, target.real_time, target.observed, target.error_at)
            and dict(request.apply) == reductions
        )
    )
